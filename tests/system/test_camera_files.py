"""What the files of a camera tell of themselves, layout, levels, gain and exposure, against flags, sessions and models."""

import json
import struct

import numpy as np
import pytest
from PIL import Image

BAYER_MODEL = "sony-a7s2"  # bayer-rggb, black 512, ISO
POLAR_MODEL = "imx250mzr-simulated"  # polar-mono, black 80, dB
CODES = {"r": 0, "g": 1, "b": 2}
KINDS = {1: ("B", 1), 2: ("B", 1), 3: ("H", 2), 4: ("I", 4), 5: ("I", 4), 10: ("i", 4)}  # of TIFF


def directory(tags, at):
    """A little-endian TIFF directory as it lies at `at`: tag to type and values."""
    head, extra = struct.pack("<H", len(tags)), b""
    extra_at = at + 2 + 12 * len(tags) + 4
    for tag in sorted(tags):
        kind, values = tags[tag]
        content = struct.pack(f"<{len(values)}{KINDS[kind][0]}", *values)
        head += struct.pack("<HHI", tag, kind, len(values) // (2 if kind in (5, 10) else 1))
        if len(content) <= 4:
            head += content.ljust(4, b"\0")
        else:
            head += struct.pack("<I", extra_at + len(extra))
            extra += content + b"\0" * (len(content) % 2)
    return head + struct.pack("<I", 0) + extra


def write_dng(path, pixels, pattern="rggb", black=(512, 512, 512, 512), iso=400, exposure=0.01, corner=None):
    """A DNG 1.4; black: the 2x2 pattern from the visible corner, in hundredths; iso 0 and exposure None: not told."""
    rows, cols = pixels.shape
    data = np.ascontiguousarray(pixels.astype("<u2")).tobytes()
    data += b"\0" * (len(data) % 2)
    exif = {} if iso == 0 else {34855: (3, [iso])}
    if exposure is not None:
        exif[33434] = (5, [round(exposure * 1_000_000), 1_000_000])
    exif_at = 8 + len(data)
    exif_bytes = directory(exif, exif_at)
    hundredths = [n for level in black for n in (round(100 * level), 100)]
    tags = {254: (4, [0]), 256: (4, [cols]), 257: (4, [rows]), 258: (3, [16]), 259: (3, [1]), 262: (3, [32803]),
            271: (2, b"Maker\0"), 272: (2, b"Model\0"), 273: (4, [8]), 274: (3, [1]), 277: (3, [1]), 278: (4, [rows]),
            279: (4, [len(data)]), 33421: (3, [2, 2]), 33422: (1, [CODES[c] for c in pattern]), 34665: (4, [exif_at]),
            50706: (1, [1, 4, 0, 0]), 50708: (2, b"Maker Model\0"), 50710: (1, [0, 1, 2]), 50711: (3, [1]),
            50713: (3, [2, 2]), 50714: (5, hundredths), 50717: (4, [16383]),
            50721: (10, [1, 1, 0, 1, 0, 1, 0, 1, 1, 1, 0, 1, 0, 1, 0, 1, 1, 1]), 50728: (5, [1, 1, 1, 1, 1, 1])}
    if corner:
        tags[50829] = (4, [*corner, rows, cols])
    at = exif_at + len(exif_bytes)
    path.write_bytes(struct.pack("<2sHI", b"II", 42, at) + data + exif_bytes + directory(tags, at))
    return path


def noise_frame(seed, rows=64, cols=64, level=900.0, sd=10.0):
    return np.random.default_rng(seed).normal(level, sd, (rows, cols)).round()


@pytest.fixture
def dng(tmp_path):
    return write_dng(tmp_path / "f.dng", noise_frame(1), pattern="grbg", black=(510, 514, 508, 512))


# Layout: a model's is for files that do not know theirs.


@pytest.mark.parametrize("command", [["denoise"], ["stokes"], ["renoise", "--from", "400", "--to", "1600"]])
@pytest.mark.parametrize("model", [BAYER_MODEL, POLAR_MODEL])
def test_a_file_of_another_layout_than_the_model_is_refused(refused, dng, tmp_path, command, model):
    if command[0] == "renoise" and model == POLAR_MODEL:
        command = ["renoise", "--from", "6", "--to", "12"]
    line = refused(command[0], dng, "--model", model, *command[1:], "-o", tmp_path / "out")
    own = "bayer-rggb" if model == BAYER_MODEL else "polar-mono"
    assert f"f.dng: has the layout bayer-grbg, the noise model {own}" in line
    assert not (tmp_path / "out").exists()


def test_what_malus_stored_as_mono_is_no_colour_frame(malus, refused, tmp_path):
    np.save(tmp_path / "c.npy", np.full((64, 64), 300, np.float32))
    malus("synthesize", tmp_path / "c.npy", "--model", POLAR_MODEL, "--gain", 12, "-o", tmp_path)
    line = refused("stokes", tmp_path / "c_000.tif", "--model", "imx250myr-simulated", "-o", tmp_path / "out")
    assert "has the layout polar-mono, the noise model polar-bayer-rggb" in line


def test_data_sets_guides_and_references_keep_the_files_layout(refused, malus, dng, tmp_path):
    plan = tmp_path / "plan.toml"
    plan.write_text(f'model = "{BAYER_MODEL}"\nclean = "f.dng"\n[dataset]\nsamples = 2\npatch = 16\n')
    assert "f.dng: has the layout bayer-grbg" in refused("dataset", plan, "-o", tmp_path / "set")
    own = write_dng(tmp_path / "own.dng", noise_frame(2))
    line = refused("renoise", own, "-m", BAYER_MODEL, "--from", 400, "--to", 1600, "--guide", dng, "-o", tmp_path / "out")
    assert "f.dng: has the layout bayer-grbg" in line
    line = refused("denoise", own, "--model", BAYER_MODEL, "--reference", dng, "-o", tmp_path / "out")
    assert "f.dng: has the layout bayer-grbg, the frame bayer-rggb" in line
    malus("denoise", own, "--model", BAYER_MODEL, "-o", tmp_path / "out")


def test_a_file_without_a_layout_gets_the_models(malus, tmp_path):
    np.save(tmp_path / "raw.npy", noise_frame(3).astype(np.uint16))
    run = malus("denoise", tmp_path / "raw.npy", "--model", BAYER_MODEL, "--iso", 400, "--black", "510,511,512,513",
                "-o", tmp_path, "--json").json
    assert run["layout"] == "bayer-rggb"
    assert json.loads((tmp_path / "raw_denoised.json").read_text())["black_dn"] == [510, 511, 512, 513]


# Black levels of DNG files.


@pytest.mark.parametrize("top", [0, 1, 2, 3])
@pytest.mark.parametrize("left", [0, 1, 4])
def test_black_levels_follow_an_odd_visible_corner(malus, tmp_path, top, left):
    """LibRaw shows from an even corner on, the levels count from the file's: here pixels are their black level."""
    black = np.array([[500, 510], [520, 530]])
    pixels = np.roll(np.tile(black, (33, 34)), (top % 2, left % 2), (0, 1))
    frame = write_dng(tmp_path / "f.dng", pixels, "grbg", black.ravel(), corner=(top, left))
    info = malus("info", frame, "--json").json
    assert info["black"] == info["mean"]["value"]
    own = {500: "G1", 510: "R", 520: "B", 530: "G2"}  # the two greens are named by their rows
    assert [n[0] for n in info["channels"]] == [own[v][0] for v in info["black"]]


def test_fractions_of_black_levels_are_kept(malus, tmp_path):
    frame = write_dng(tmp_path / "f.dng", noise_frame(1), black=(64.75, 64.5, 60.1, 64))
    assert malus("info", frame, "--json").json["black"] == [64.75, 64.5, 60.1, 64]


def test_a_declared_layout_keeps_black_by_its_place(malus, refused, dng, tmp_path):
    info = malus("info", dng, "--layout", "bayer-rggb", "--json").json
    assert info["black_known"] and info["black"] == [510, 514, 508, 512]
    info = malus("info", dng, "--layout", "polar-bayer-rggb", "--json").json
    assert info["black"] == [510, 514] * 2 + [508, 512] * 2 + [510, 514] * 2 + [508, 512] * 2
    assert "tells 4 black levels for its layout bayer-grbg" in refused("info", dng, "--layout", "mono")
    run = malus("denoise", dng, "--layout", "bayer-rggb", "--model", BAYER_MODEL, "-o", tmp_path)
    assert "its layout is bayer-grbg as the file says, taken as bayer-rggb as declared" in run.err
    assert "black level not known" not in run.err
    write_set(tmp_path, "d", 400, 0.001)
    session = session_of(tmp_path, ("bias", "d*.dng", ""))
    session.write_text(session.read_text().replace("[[frames]]", 'layout = "bayer-grbg"\n[[frames]]'))
    run = malus("calibrate", session, "-o", tmp_path / "m.h5", "--json")
    assert "its layout is bayer-rggb as the file says, taken as bayer-grbg as declared" in run.err
    assert run.json["black"]["value"] == [512] * 4


# Gain and exposure.


def write_set(folder, name, iso, exposure, frames=4, level=512.0, sd=10.0):
    folder.mkdir(exist_ok=True)
    for i in range(frames):
        seed = sum(map(ord, name)) * 100 + i
        write_dng(folder / f"{name}{i}.dng", noise_frame(seed, level=level, sd=sd), iso=iso, exposure=exposure)


def session_of(folder, *groups):
    text = '[sensor]\nname = "DNG"\n'
    for kind, paths, extra in groups:
        text += f'[[frames]]\nkind = "{kind}"\npaths = ["{paths}"]\n{extra}\n'
    (folder / "s.toml").write_text(text)
    return folder / "s.toml"


def test_a_silent_session_takes_gain_and_exposure_from_the_files(malus, tmp_path):
    for iso, sd in ((100, 3), (400, 10)):
        write_set(tmp_path, f"d{iso}_", iso, 0.001, sd=sd)
    session = session_of(tmp_path, ("bias", "d100_*.dng", ""), ("bias", "d400_*.dng", ""))
    shown = malus("calibrate", session, "-o", tmp_path / "m.h5", "--json").json
    assert [g["iso"] for g in shown["gains"]] == [100, 400]
    low, high = (np.mean(g["temporal_sd_dark"]["value"]) for g in shown["gains"])
    assert low == pytest.approx(3, rel=0.1) and high == pytest.approx(10, rel=0.1)


def exif_of(tags, first):
    """A TIFF structure: `first` in the directory that begins it, the tags in that of Exif, behind it."""
    at = 8 + len(directory(first | {34665: (4, [0])}, 8))
    return struct.pack("<2sHI", b"II", 42, 8) + directory(first | {34665: (4, [at])}, 8) + directory(tags, at)


@pytest.mark.parametrize("ending", ["tif", "png"])
def test_exif_tells_gain_and_exposure(malus, tmp_path, ending):
    def told(tags, text=b""):
        Image.fromarray(noise_frame(1).astype(np.uint16)).save(
            tmp_path / f"f.{ending}", exif=b"Exif\0\0" + exif_of(tags, {270: (2, text + b"\0")} if text else {}))
        return malus("info", "--json", tmp_path / f"f.{ending}").json

    shown = told({33434: (5, [1, 100]), 34855: (3, [400])})
    assert (shown["iso"], shown["exposure_s"]) == (400, 0.01)
    assert told({34855: (3, [65535]), 34867: (4, [102400])})["iso"] == 102400  # what two bytes do not hold
    assert told({34855: (3, [65535])})["iso"] is None and told({34855: (3, [0])})["iso"] is None
    if ending == "tif":  # malus' own word wins
        shown = told({34855: (3, [400])}, b"[malus gain_db=12]")
        assert shown["gain_db"] == 12 and shown["iso"] is None


@pytest.mark.parametrize("kinds", ["physics", "dark-frames"])
def test_frames_of_two_settings_are_no_set(refused, tmp_path, kinds):
    write_set(tmp_path, "d400_", 400, 0.001)
    write_set(tmp_path, "e1600_", 1600, 0.001)
    for extra in ("", "iso = 400", "gain_db = 3"):
        line = refused("calibrate", session_of(tmp_path, ("bias", "*.dng", extra)), "--kind", kinds, "-o", tmp_path / "m.h5")
        assert "e1600_0.dng: was taken at ISO 1600" in line and "d400_0.dng of the same set at ISO 400" in line
    line = refused("calibrate", session_of(tmp_path, ("bias", "d*.dng", "iso = 800")), "-o", tmp_path / "m.h5")
    assert "d400_0.dng: was taken at ISO 400, the session says ISO 800" in line
    assert not (tmp_path / "m.h5").exists()


def test_exposures_of_a_set_agree_but_for_rounding(malus, refused, tmp_path):
    write_set(tmp_path, "d", 400, 1 / 60)
    for extra in ("", "exposure_s = 0.0167", "exposure_s = 0.015625", "exposure_s = 0"):
        malus("calibrate", session_of(tmp_path, ("bias", "d*.dng", extra)), "-o", tmp_path / "m.h5", "--force")
    line = refused("calibrate", session_of(tmp_path, ("bias", "d*.dng", "exposure_s = 0.02")), "-o", tmp_path / "n.h5")
    assert "was taken at 0.016667 s, the session says 0.02 s" in line
    write_dng(tmp_path / "e.dng", noise_frame(1), exposure=0.02)
    line = refused("calibrate", session_of(tmp_path, ("bias", "*.dng", "")), "-o", tmp_path / "n.h5")
    assert "e.dng: was taken at 0.02 s" in line and "d0.dng of the same set at 0.016667 s" in line


def test_cameras_that_tell_no_iso_are_taken_at_the_sessions_word(malus, refused, tmp_path):
    write_set(tmp_path, "d", 0, None)
    shown = malus("calibrate", session_of(tmp_path, ("bias", "d*.dng", "iso = 200")), "-o", tmp_path / "m.h5", "--json").json
    assert [g["iso"] for g in shown["gains"]] == [200]
    malus("calibrate", session_of(tmp_path, ("bias", "d*.dng", "")), "-o", tmp_path / "m.h5", "--force")
    write_dng(tmp_path / "e.dng", noise_frame(1), iso=400, exposure=None)
    line = refused("calibrate", session_of(tmp_path, ("bias", "*.dng", "")), "-o", tmp_path / "n.h5")
    assert "e.dng: was taken at ISO 400, but" in line and "tells no gain" in line


def test_pairs_take_the_ratio_from_the_files(malus, refused, tmp_path):
    write_set(tmp_path, "r", 100, 0.1, level=2512)
    write_set(tmp_path, "s", 1600, 0.01, level=512 + 2000 * 1.6)
    session = session_of(tmp_path, ("reference", "r*.dng", ""), ("short", "s*.dng", ""))
    (pair,) = malus("pairs", session, "-o", tmp_path / "out", "--json").json["pairs"]
    assert pair["ratio"] == pytest.approx(0.625) and abs(pair["deviation"]) < 0.01
    write_set(tmp_path, "s", 1600, None, level=3712)
    assert "ratio is not known" in refused("pairs", session, "-o", tmp_path / "no")
    assert not (tmp_path / "no").exists()


def test_renoise_believes_the_frame_of_its_gain(malus, refused, tmp_path):
    frame = write_dng(tmp_path / "f.dng", noise_frame(1), iso=400)
    base = ["renoise", frame, "-m", BAYER_MODEL, "--to", 1600, "-o", tmp_path / "out"]
    assert "was taken at ISO 400, --from says ISO 100" in refused(*base, "--from", 100)
    malus(*base, "--from", 400)
