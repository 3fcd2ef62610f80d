"""malus model: what is shown, in text and JSON, and what is refused."""

import math
import pathlib
import shutil

import h5py
import numpy as np
import pytest

SEEDS = pathlib.Path(__file__).resolve().parents[2] / "fuzz/corpus/model"


def test_show_follows_the_contract(malus):
    model = malus("model", "show", "imx250myr-simulated", "--json").json
    assert model["layout"] == "polar-bayer-rggb" and model["row_group"] == 2
    assert model["kinds"] == ["physics"] and len(model["channels"]) == 16
    assert [gain["gain_db"] for gain in model["gains"]] == [0, 6, 12, 18, 24, 30]
    for gain in model["gains"]:
        assert gain["iso"] is None
        for name, key, unit in (("K", "value", "DN/e-"), ("mu", "mean", "DN"), ("sigma_row", "mean", "DN"),
                                ("sigma_tl", "mean", "DN"), ("lambda", "mean", "1"),
                                ("read_noise", "value", "e-"), ("temporal_sd_dark", "value", "DN")):
            assert len(gain[name][key]) == 16 and gain[name]["unit"] == unit, name
        for name in ("mu", "sigma_row"):
            assert len(gain[name]["covariance"]) == 16 and len(gain[name]["covariance"][0]) == 16
    low, high = model["joint"]["log_K_range"]
    assert low < high
    assert len(model["joint"]["slopes"]["sigma_tl"][0]) == 16


def test_one_gain_measured_and_between(malus):
    measured = malus("model", "show", "imx250myr-simulated", "--gain", 24, "--json").json["gains"]
    between = malus("model", "show", "imx250myr-simulated", "--gain", 21, "--json").json["gains"]
    assert len(measured) == len(between) == 1
    ratio = measured[0]["K"]["value"][0] / between[0]["K"]["value"][0]
    assert ratio == pytest.approx(10 ** (3 / 20), rel=1e-3)
    assert "not measured" in between[0]["warnings"][0]


def test_text_names_units_and_the_origin(malus):
    text = malus("model", "show", "sony-a7s2").out
    for word in ("DN/e-", "e-", "ISO 2000", "14 bit", "conversion gain between ISO 1600 and ISO 2000"):
        assert word in text
    assert "SIMULATED" in malus("model", "show", "imx250myr-simulated").out


def test_tables_are_no_wider_than_a_terminal(malus):
    lines = malus("model", "show", "imx250myr-simulated").out.splitlines()
    tables = [line for line in lines if len(line.split()) >= 7 and ("." in line.split()[1] or line.split()[0] in ("gain", "channel"))]
    assert len(tables) > 100 and max(map(len, tables)) <= 80


def test_numbers_that_no_frames_gave_are_not_told_as_measured(malus):
    shown = malus("model", "show", "imx250mzr-simulated").out
    assert "stated, not measured from frames here" in shown and "0 bias frames" not in shown


def test_list_and_show_agree(malus):
    names = [model["name"] for model in malus("model", "list", "--json").json["models"]]
    assert "imx250myr-simulated" in names and "sony-a7s2" in names
    for name in names:
        assert malus("model", "show", f"builtin:{name}", "--json").json["gains"]


def test_check_predicts_the_gains_between(malus):
    gains = malus("model", "check", "sony-a7s2", "--json").json["physics"]
    told = malus("model", "check", "sony-a7s2").out
    assert told.startswith("sony-a7s2: ") and "Every gain is left out once" in told and "not predicted: " in told
    assert max(len(line) for line in told.splitlines()) <= 100
    by_name = {gain["gain"]: gain for gain in gains}
    assert not by_name["ISO 1600"]["predicted"] and not by_name["ISO 50"]["predicted"]
    assert abs(by_name["ISO 3200"]["read_noise_error"]) < 0.02
    assert by_name["ISO 3200"]["sqrt_jsd"] < 0.1 * by_name["ISO 3200"]["sqrt_jsd_nearest"]


@pytest.mark.parametrize("arguments, words", [
    (["imx250myr-simulated", "--gain", 40], "0 dB to 30 dB"),
    (["imx250myr-simulated", "--iso", 400], "in dB"),
    (["sony-a7s2", "--iso", 1800], "between ISO 1600 and ISO 2000"),
    (["sony-a7s2", "--iso", 1800, "--extrapolate-gain"], "between ISO 1600 and ISO 2000"),
    (["no-such-model"], "does not exist"),
    (["builtin:sony-a7s3"], "builtin:sony-a7s2"),
])
def test_refused(refused, arguments, words):
    assert words in refused("model", "show", *arguments)


def test_extrapolation_is_allowed_when_asked_for(malus):
    gain = malus("model", "show", "imx250myr-simulated", "--gain", 36, "--extrapolate-gain", "--json").json["gains"][0]
    assert gain["K"]["value"][0] == pytest.approx(24.1, rel=0.02)


@pytest.mark.parametrize("name, change, words", [
    ("sensor/name", lambda file, name: file.create_dataset(name, data="camera"), "is text of variable length; store it as text of fixed length"),
    ("physics/000/K/mean", lambda file, name: file.create_dataset(name, data=np.ones(2), compression="lzf"), "(lzf); store it with gzip"),
])
def test_what_h5py_writes_otherwise_is_told(refused, tmp_path, name, change, words):
    shutil.copy(SEEDS / "good_full.h5", tmp_path / "m.h5")
    with h5py.File(tmp_path / "m.h5", "a") as file:
        del file[name]
        change(file, name)
    assert words in refused("model", "show", tmp_path / "m.h5")


@pytest.mark.parametrize("unit, words", [
    (np.bytes_("e-"), 'physics/000/K/mean has the attribute unit "e-", not "DN/e-"; store its values in "DN/e-"'),
    (np.bytes_("DN"), 'the attribute unit "DN", not "DN/e-"'),
    (np.bytes_("DN" * 30), 'DNDN...", not "DN/e-"'),
    (1.0, "an attribute unit that is not one text"),
    (np.array([b"DN/e-", b"DN/e-"]), "an attribute unit that is not one text"),
    (h5py.Empty("S6"), "an attribute unit that is not one text"),
])
def test_values_in_another_unit_are_refused(refused, tmp_path, unit, words):
    shutil.copy(SEEDS / "good_full.h5", tmp_path / "m.h5")
    with h5py.File(tmp_path / "m.h5", "a") as file:
        file["physics/000/K/mean"].attrs["unit"] = unit
    line = refused("model", "show", tmp_path / "m.h5")
    assert "m.h5: " in line and words in line


def test_units_as_other_programs_write_them_are_read(malus, tmp_path):
    """Those of variable length are not: libhdf5 crashes on a damaged heap of them."""
    shutil.copy(SEEDS / "good_full.h5", tmp_path / "m.h5")
    with h5py.File(tmp_path / "m.h5", "a") as file:
        file["physics/000/K/mean"].attrs["unit"] = np.bytes_("DN/e-   ")
        file["physics/000/K/spread"].attrs["unit"] = np.array([b"DN/e-"])
        file["physics/000/K/covariance"].attrs["unit"] = "any"
        del file["physics/000/K/standard_error"].attrs["unit"]
    malus("model", "show", tmp_path / "m.h5")


@pytest.mark.parametrize("seed", sorted(path.name for path in SEEDS.glob("bad_*.h5")))
def test_misleading_files_are_refused(refused, seed, tmp_path):
    shutil.copy(SEEDS / seed, tmp_path / seed)
    assert seed in refused("model", "show", tmp_path / seed)


def test_a_gain_without_K_is_shown_by_the_joint_model_and_says_so(malus, tmp_path):
    h5py = pytest.importorskip("h5py")
    shutil.copy(SEEDS / "good_full.h5", tmp_path / "m.h5")
    with h5py.File(tmp_path / "m.h5", "a") as file:
        gain = file["physics/001/gain_db"][()]
        del file["physics/001/K"]
    show = "model", "show", tmp_path / "m.h5", "--gain"
    assert "warning: its K was not measured: all from the joint model" in malus(*show, gain).out
    between = malus(*show, gain - 1).out
    assert "its K" not in between and "not measured at this gain: from the joint model" in between


def test_a_conversion_gain_of_one_gain_shows_no_laws(malus, tmp_path):
    """They would be of one point each."""
    shutil.copy(SEEDS / "good_full.h5", tmp_path / "m.h5")

    def keep(group, key, part):
        values, attributes = group[key][part], dict(group[key].attrs)
        del group[key]
        group.create_dataset(key, data=values).attrs.update(attributes)

    with h5py.File(tmp_path / "m.h5", "a") as file:
        segment = file["joint/segments/000"]
        for key in ("knots_db", "knots_log_K", "lambda"):
            keep(segment, key, slice(1))
        for law in [item for item in segment.values() if isinstance(item, h5py.Group)]:
            keep(law, "residual", (slice(None), slice(1)))
    whole, one = (malus("model", "show", path).out.split("\nJoint model over gain")[1].split("\n\n")[0] for path in
                  (SEEDS / "good_full.h5", tmp_path / "m.h5"))
    assert "log(sigma_TL)" in whole and "one gain" not in whole
    assert one.splitlines()[1:] == ["  0 dB, K 0.4 DN/e-: one gain, with no other to go to"]


def test_a_model_file_is_plain_for_h5py(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(SEEDS / "good_full.h5") as file:
        assert file.attrs["version"] == 1
        found = []

        def look(name, item):
            if isinstance(item, h5py.Dataset):
                found.append(name)
                assert isinstance(item.attrs["unit"], str), name
                description = item.attrs["description"]
                assert description and "\n" not in description, name

        file.visititems(look)
        assert len(found) > 150
        assert file["physics/001/gain_db"][()] == 6
        assert file["physics/001/K/mean"].shape == (2,)
        assert file["physics/001/mu/covariance"].shape == (2, 2)


def test_wrong_usage(malus):
    malus("model", code=2)
    malus("model", "show", code=2)
    malus("model", "show", "sony-a7s2", "--gain", 1, "--iso", 100, code=2)


def test_warnings_of_every_kind_are_shown(malus, tmp_path):
    rng = np.random.default_rng(6)
    for name, level in (("bias", 0), ("flat0", 1000), ("flat1", 2000)):
        for frame in range(6):
            pixels = 2 * rng.poisson(level / 2, (64, 64)) + 3 * rng.standard_normal((64, 64)) + 64
            np.save(tmp_path / f"{name}_{frame}.npy", np.rint(pixels).astype(np.uint16))
    session = '[sensor]\nlayout = "mono"\nblack = 64\nwhite = 4095\n'
    for name in ("bias", "flat0", "flat1"):
        session += f'[[frames]]\nkind = "{name[:4]}"\ngain_db = 0\npaths = ["{name}_*.npy"]\n'
    (tmp_path / "session.toml").write_text(session)
    arguments = ("calibrate", tmp_path / "session.toml", "--kind", "physics,nonparametric", "--level-samples", 2000)
    warning = "no frames between"  # the dark frames and the first flats
    for name, flags in (("a.h5", ()), ("b.h5", ("--json",))):
        done = malus(*arguments, "-o", tmp_path / name, *flags)
        told = [line for line in done.err.splitlines() if warning in line]
        assert len(told) == 1 and told[0].startswith("warning: 0 dB, non-parametric: ")
        assert flags or warning not in done.out
    assert warning in malus("model", "show", tmp_path / "a.h5").out


def test_dsnu_has_a_standard_error_that_older_files_lack(malus, tmp_path):
    h5py = pytest.importorskip("h5py")
    rng = np.random.default_rng(7)
    pattern = rng.normal(0, 2, (64, 64))
    for frame in range(6):
        np.save(tmp_path / f"bias_{frame}.npy", np.rint(64 + pattern + rng.normal(0, 3, (64, 64))).astype(np.uint16))
    (tmp_path / "s.toml").write_text('[sensor]\nlayout = "mono"\nblack = 64\nwhite = 4095\n[[frames]]\nkind = "bias"\n'
                                     'gain_db = 0\npaths = ["bias_*.npy"]\n')
    malus("calibrate", tmp_path / "s.toml", "-o", tmp_path / "m.h5")
    show = ("model", "show", tmp_path / "m.h5")
    dsnu = malus(*show, "--json").json["gains"][0]["dsnu"]
    # 4096 pixels of 2² + 3²/6 DN²; four standard errors.
    assert dsnu["stderr"][0] == pytest.approx(np.sqrt(2 / 4096) * 5.5 / 4, rel=0.15)
    assert abs(dsnu["value"][0] - 2) < 4 * dsnu["stderr"][0]
    assert "DSNU 2.0" in malus(*show).out or "DSNU 1.9" in malus(*show).out
    with h5py.File(tmp_path / "m.h5", "a") as file:
        gain, = file["physics"]
        assert file[f"physics/{gain}/dsnu_stderr_dn"].attrs["unit"] in ("DN", b"DN")
        del file[f"physics/{gain}/dsnu_stderr_dn"]
    older = malus(*show, "--json").json["gains"][0]["dsnu"]
    assert older["value"] == dsnu["value"] and not older.get("stderr")
    assert "DSNU" in malus(*show).out


def test_older_files_are_read_smooth_inside_the_codes(malus, tmp_path):
    """Without dark_before_rounding level 0 is even inside each code, which is a sixth of its square too much variance."""
    rng, sigma, text = np.random.default_rng(5), 0.6, '[sensor]\nlayout = "mono"\nblack = 10\nwhite = 255\n'
    frames = np.round(10 + sigma * rng.standard_normal((12, 128, 128))).astype(np.uint16)
    flats = np.round(50 + math.sqrt(2 + sigma**2) * rng.standard_normal((6, 128, 128))).astype(np.uint16)
    for kind, images in (("bias", frames), ("flat", flats)):
        for number, image in enumerate(images):
            np.save(tmp_path / f"{kind}{number:02}.npy", image)
        text += f'[[frames]]\nkind = "{kind}"\ngain_db = 0\nexposure_s = 0.01\npaths = ["{kind}*.npy"]\n'
    (tmp_path / "s.toml").write_text(text)
    new, old = tmp_path / "new.h5", tmp_path / "old.h5"
    malus("calibrate", tmp_path / "s.toml", "--kind", "nonparametric", "--level-samples", 5000, "-o", new)
    shutil.copy(new, old)
    with h5py.File(old, "r+") as file:
        group = file["nonparametric/000"]
        assert group["dark_before_rounding"][()] == 1
        del group["dark_before_rounding"]
        edges, pmf = group["channels/000/bin_edges_dn"][:], group["channels/000/pmf"]
        code = np.round(0.5 * (edges[1:] + edges[:-1]))
        for value in np.unique(code):
            own, width = code == value, np.diff(edges)
            pmf[0, own] = pmf[0, own].sum() * width[own] / width[own].sum()
    for model in (new, old):
        (shown,) = malus("model", "show", model, "--json").json["nonparametric"]
        assert shown["channels"][0]["sd"][0] == pytest.approx(math.sqrt(sigma**2 + 1 / 12), rel=0.01), model
    np.save(tmp_path / "dark.npy", np.zeros((512, 512), np.float32))
    malus("synthesize", tmp_path / "dark.npy", "-m", old, "--kind", "nonparametric", "--gain", 0, "--format", "npy", "-o", tmp_path / "out")
    drawn = np.load(tmp_path / "out/dark_000.npy")
    for value in (9, 10, 11):
        share = (frames == value).mean()
        assert (drawn == value).mean() == pytest.approx(share, abs=4.5 * math.sqrt(share / drawn.size)), value
