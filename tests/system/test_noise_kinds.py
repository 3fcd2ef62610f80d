"""Every kind of noise model as a user gets it: calibrated, taken from a DNG, shown, drawn; and real frames against drawn ones."""

import struct

import numpy as np
import pytest
from PIL import Image

pytestmark = pytest.mark.slow


def write_mono_session(folder, gain=0.5, read=2.0):
    """Bias frames, flats and a burst of a camera with Gaussian read noise; black 100, 12 bit."""
    rng = np.random.default_rng(11)
    groups = []

    def save(kind, number, mean, seconds):
        frame = np.round(100 + gain * rng.poisson(mean / gain) + rng.normal(0, read, mean.shape))
        name = f"{kind}_{number:03}.png"
        Image.fromarray(np.clip(frame, 0, 4095).astype(np.uint16)).save(folder / name)
        groups.append((kind, seconds, name))

    for n in range(12):
        save("bias", n, np.zeros((128, 128)), 0)
    for n in range(16):
        save("flat", n, np.full((128, 128), 150.0 * (n // 2 + 1)), 0.001 * (n // 2 + 1))
    ramp = np.repeat(np.repeat(np.linspace(20, 2600, 64).reshape(8, 8), 16, 0), 16, 1)
    for n in range(20):
        save("burst", n, ramp, 0.004)

    def session(name, *kinds):
        text = '[sensor]\nlayout = "mono"\nblack = 100\nwhite = 4095\nrow_group = 1\n'
        for kind, seconds in sorted({(k, s) for k, s, _ in groups if k in kinds}):
            paths = ", ".join(f'"{p}"' for k, s, p in groups if (k, s) == (kind, seconds))
            text += f'[[frames]]\nkind = "{kind}"\nexposure_s = {seconds}\ngain_db = 0\npaths = [{paths}]\n'
        path = folder / name
        path.write_text(text)
        return path

    return session


DRAWN = {"physics": "physics", "poisson-gaussian": "physics", "gaussian": "gaussian", "nonparametric": "nonparametric",
         "dark-frames": "dark-frames"}


@pytest.mark.parametrize("kind", DRAWN)
def test_every_kind_is_calibrated_shown_and_drawn(malus, tmp_path, kind):
    session = write_mono_session(tmp_path)("s.toml", "bias", "flat", "burst")
    model = tmp_path / "model.h5"
    needed = [DRAWN[kind]] if kind != "dark-frames" else ["physics", "dark-frames"]
    malus("calibrate", session, "--kind", *needed, "--level-samples", 4000, "-o", model)
    assert set(needed) <= set(malus("model", "show", model, "--json").json["kinds"])
    assert DRAWN[kind] in malus("model", "show", model).out
    np.save(tmp_path / "flat.npy", np.full((256, 256), 600, np.float32))
    done = malus("synthesize", tmp_path / "flat.npy", "-m", model, "--kind", kind, "--gain", 0, "-o", tmp_path / "out")
    assert ("128 x 128 pixels are laid side by side to fill 256 x 256" in done.err) == (kind == "dark-frames")
    dn = np.array(Image.open(tmp_path / "out/flat_000.tif")).astype(float)
    assert dn.mean() == pytest.approx(700, abs=0.6)
    # K s + read² + rounding: 300 + 4 + 1/12; calibrated from 2 x 16384 pixels a level.
    assert dn.var() == pytest.approx(0.5 * 600 + 4 + 1 / 12, rel=0.05)


def test_gaussian_model_from_a_burst_alone(malus, refused, tmp_path):
    session = write_mono_session(tmp_path)
    model = tmp_path / "model.h5"
    malus("calibrate", session("burst.toml", "burst"), "--kind", "gaussian", "--level-samples", 4000, "-o", model)
    (gain,) = malus("model", "show", model, "--json").json["gaussian"]
    assert gain["slope"]["value"][0] == pytest.approx(0.5, rel=0.04)
    assert gain["offset"]["value"][0] == pytest.approx(4 + 1 / 12, abs=5 * gain["offset"]["stderr"][0] + 2)
    refused("calibrate", session("bias.toml", "bias"), "--kind", "gaussian", "-o", tmp_path / "none.h5")


# real frames

def row_spectrum(frames):
    """Power of the rows' temporal offsets in eight bands, low to high; offsets of white noise give equal numbers."""
    rows = frames.mean(axis=2)
    rows = rows - rows.mean(axis=1, keepdims=True)
    rows -= rows.mean(axis=0)
    power = (np.abs(np.fft.rfft(rows, axis=1)) ** 2).mean(axis=0) / rows.shape[1] * len(rows) / (len(rows) - 1)
    return np.array([band.mean() for band in np.array_split(power[1:], 8)])


@pytest.mark.slow
def test_synthesized_dark_frames_have_the_rows_of_real_ones(malus, shared, tmp_path):
    images = shared / "emva001/images"
    dark = sorted(images.glob("d_s_000_*.png"))
    flats = sorted(images.glob("b_[0-9]*.png"))
    text = '[sensor]\nlayout = "mono"\nblack = 0\nwhite = 4095\n'
    for kind, level, paths in [("bias", 0, dark[::2])] + [("flat", i + 1, flats[2 * i:2 * i + 2]) for i in range(len(flats) // 2)]:
        text += f'[[frames]]\nkind = "{kind}"\nlevel = {level}\nexposure_s = {level / 1000}\ngain_db = 0\npaths = ['
        text += ", ".join(f'"{path}"' for path in paths) + "]\n"
    (tmp_path / "s.toml").write_text(text)
    malus("calibrate", tmp_path / "s.toml", "--kind", "physics", "nonparametric", "--level-samples", 50000, "-o", tmp_path / "m.h5")
    shown = malus("model", "show", tmp_path / "m.h5", "--json").json
    for held in (shown["gains"][0], shown["nonparametric"][0]):
        drift = held["row_drift"]
        assert abs(drift["share"]["value"] - 0.33) < 3 * drift["share"]["stderr"] < 0.12
        assert abs(drift["length"]["value"] - 1.97) < 3 * drift["length"]["stderr"] < 0.9 and drift["length"]["unit"] == "row groups"
    assert "rows drift slowly" in malus("model", "show", tmp_path / "m.h5").out
    real = np.stack([np.array(Image.open(path)).astype(float) for path in dark[1::2]])
    np.save(tmp_path / "dark.npy", np.zeros(real.shape[1:], np.float32))
    spectra = {}
    for name, flags in (("nonparametric", ["--kind", "nonparametric"]), ("physics", []), ("exact", ["--exact"]),
                        ("none", ["--kind", "nonparametric", "--no-row"])):
        malus("synthesize", tmp_path / "dark.npy", "-m", tmp_path / "m.h5", "--gain", 0, "--frames", 25, "-o", tmp_path / name, *flags)
        drawn = np.stack([np.array(Image.open(path)).astype(float) for path in sorted((tmp_path / name).iterdir())])
        spectra[name] = row_spectrum(drawn)
    truth = row_spectrum(real)
    for name, spectrum in spectra.items():
        print(name.rjust(14), spectrum.round(3), (spectrum / truth).round(2))
    print("real".rjust(14), truth.round(3))
    # 25 frames of 30 frequencies a band: sampling error 3.7 % a band and set, 5.2 % of their ratio; four of these.
    for name in ("nonparametric", "physics", "exact"):
        assert (np.abs(spectra[name] / truth - 1) < 0.21).all(), name
        assert spectra[name].mean() == pytest.approx(truth.mean(), rel=0.08)
    assert spectra["none"].mean() < 0.1 * truth.mean()


# DNG

def write_dng(path, pairs):
    """A little-endian TIFF with nothing but a NoiseProfile."""
    numbers = [value for pair in pairs for value in pair]
    path.write_bytes(struct.pack("<2sHIHHHIII", b"II", 42, 8, 1, 51041, 12, len(numbers), 26, 0) +
                     struct.pack(f"<{len(numbers)}d", *numbers))
    return path


def test_noise_profile_of_a_dng_becomes_a_model(malus, refused, misused, tmp_path):
    pairs = [(4e-4, 2e-6), (3e-4, 1e-6), (5e-4, 3e-6)]  # red, green, blue
    frame = write_dng(tmp_path / "frame.dng", pairs)
    facts = ["--layout", "bayer-grbg", "--black", 64, "--white", 1064, "--iso", 800]
    malus("model", "from-dng", frame, *facts, "-o", tmp_path / "m.h5")
    shown = malus("model", "show", tmp_path / "m.h5", "--json").json
    (gaussian,) = shown["gaussian"]
    assert gaussian["iso"] == 800 and "frame.dng" in shown["origin"]
    planes = [pairs[k] for k in (1, 0, 2, 1)]
    assert np.allclose(gaussian["slope"]["value"], [s * 1000 for s, _ in planes])
    assert np.allclose(gaussian["offset"]["value"], [o * 1e6 for _, o in planes])
    np.save(tmp_path / "flat.npy", np.full((400, 400), 500, np.float32))
    malus("synthesize", tmp_path / "flat.npy", "-m", tmp_path / "m.h5", "--kind", "gaussian", "--iso", 800, "--float",
          "--format", "npy", "-o", tmp_path / "out")
    noise = np.load(tmp_path / "out/flat_000.npy").astype(float) - 500
    for channel, (slope, offset) in enumerate(planes):
        variance = noise[channel // 2::2, channel % 2::2].var()
        assert variance == pytest.approx(slope * 1000 * 500 + offset * 1e6, rel=5 * np.sqrt(2 / 40000))
    assert "that is none" in refused("model", "from-dng", write_dng(tmp_path / "no.dng", []), *facts, "-o", tmp_path / "n.h5")
    refused("model", "from-dng", tmp_path / "flat.npy", *facts, "-o", tmp_path / "n.h5")
    refused("model", "from-dng", frame, *facts, "-o", tmp_path / "m.h5")
    three = misused("model", "from-dng", frame, *facts[:3], "64,65,66", *facts[4:], "-o", tmp_path / "n.h5")
    assert "--black: 3 black levels for the 4 channels of bayer-grbg; give one number, or one per channel" in three
    # A frame that nobody here decodes, a JPEG-XL DNG for one: what to do is said.
    told = refused("model", "from-dng", frame, *facts[:4], "-o", tmp_path / "n.h5")
    assert "frame.dng" in told and "without its pixels: give --layout, --black and --white" in told


def test_noise_profile_of_a_real_phone(malus, shared, tmp_path):
    frame = shared / "bayer-raw/s25u_linear_jxl.dng"
    result = malus("model", "from-dng", frame, "--layout", "bayer-grbg", "--black", 0, "--white", 65535, "--iso", 50,
                   "-o", tmp_path / "m.h5", "--json").json
    content = frame.read_bytes()
    tag = content.index(struct.pack("<HH", 51041, 12))
    count, offset = struct.unpack_from("<II", content, tag + 4)
    numbers = struct.unpack_from(f"<{count}d", content, offset)
    green = numbers[2 if count == 6 else 0]
    assert result["slope_dn"][0] == pytest.approx(green * 65535)


def test_evaluated_frames_take_black_from_the_model_and_light_from_all_of_them(malus, tmp_path):
    """Files that tell no black level, under a lamp that flickers by a percent: the scene is that of their mean."""
    rng = np.random.default_rng(8)
    lamp = 1 + 0.01 * rng.standard_normal(12)
    for number, light in enumerate(lamp):
        frame = 82 + rng.poisson(800 * light / 0.4, (128, 128)) * 0.4 + 1.2 * rng.standard_normal((128, 128))
        np.save(tmp_path / f"flat_{number:02}.npy", np.round(frame).astype(np.uint16))
    frames = sorted(tmp_path.glob("flat_*.npy"))
    given = ["--reference", *frames, "--model", "imx250myr-simulated", "--gain", 0, "--json"]
    told = malus("evaluate", "--noise", *given, "--black", 82).json
    untold = malus("evaluate", "--noise", *given).json
    assert untold["reference"]["mean_dn"] == told["reference"]["mean_dn"]
    off = np.mean(told["test"]["mean_dn"]) - np.mean(told["reference"]["mean_dn"])
    assert abs(off) < 0.1, "one frame's lamp is off by 8 DN"
