"""All kinds of models of one camera at two gains, calibrated from frames: noise on noise between them, gains in between, and
signals that the non-parametric kind has no levels for."""

import numpy as np
import pytest
from PIL import Image

BLACK, WHITE = 100, 4095
CAMERA = {0: (0.5, 1.6), 12: (2.0, 4.5)}  # gain in dB: K in DN/e-, read noise in DN
LEVELS = [0, 40, 150, 400, 900, 1300, 2200, 3200]  # DN; flats reach 1500


def taken(rng, mean, gain):
    K, read = CAMERA[gain]
    return np.clip(np.round(BLACK + K * rng.poisson(mean / K) + rng.normal(0, read, mean.shape)), 0, WHITE).astype(np.uint16)


@pytest.fixture(scope="module")
def camera(tmp_path_factory):
    """Bias frames and flats at two gains; 48 levels of 128 x 128 pixels, four frames each."""
    folder = tmp_path_factory.mktemp("camera")
    rng = np.random.default_rng(21)
    text = f'[sensor]\nlayout = "mono"\nblack = {BLACK}\nwhite = {WHITE}\nrow_group = 1\n'
    for gain in CAMERA:
        for n in range(12):
            Image.fromarray(taken(rng, np.zeros((128, 128)), gain)).save(folder / f"bias_{gain}_{n}.png")
        text += f'[[frames]]\nkind = "bias"\nexposure_s = 0\ngain_db = {gain}\npaths = ["bias_{gain}_*.png"]\n'
        for level in range(1, 49):
            for n in range(4):
                Image.fromarray(taken(rng, np.full((128, 128), level * 31.25), gain)).save(folder / f"flat_{gain}_{level}_{n}.png")
            text += (f'[[frames]]\nkind = "flat"\nexposure_s = {level / 1000}\nlevel = {level}\ngain_db = {gain}\n'
                     f'paths = ["flat_{gain}_{level}_*.png"]\n')
    (folder / "s.toml").write_text(text)
    return folder


@pytest.fixture
def model(malus, camera):
    path = camera / "m.h5"
    if not path.exists():
        malus("calibrate", camera / "s.toml", "--kind", "physics", "gaussian", "nonparametric", "dark-frames", "--dark-frames", 2,
              "--level-samples", 20000, "-o", path)
    return path


def stripes():
    """256 rows of 80 columns for every level."""
    return np.repeat(np.array(LEVELS, np.float32), 80)[None].repeat(256, 0)


def of_levels(frames):
    """Noise above black per level, all frames together."""
    frames = np.stack(frames).astype(float) - BLACK
    return [frames[:, :, 80 * i:80 * (i + 1)].ravel() - level for i, level in enumerate(LEVELS)]


def root_jsd(a, b):
    edges = np.linspace(-5, 5, 41) * b.std() + b.mean()
    p, q = (np.histogram(x, edges)[0] / x.size for x in (a, b))
    entropy = lambda h: -(h[h > 0] * np.log2(h[h > 0])).sum()
    return np.sqrt(max(entropy((p + q) / 2) - (entropy(p) + entropy(q)) / 2, 0))


def test_noise_on_noise_of_calibrated_distributions(malus, camera, model, tmp_path):
    """Levels and bins are each gain's own, as calibration chose them. 2200 and 3200 DN lie above all levels."""
    rng = np.random.default_rng(5)
    names = []
    for n in range(4):
        names.append(tmp_path / f"noisy_{n}.tif")
        Image.fromarray(taken(rng, stripes(), 0)).save(names[-1])
    np.save(tmp_path / "guide.npy", stripes())
    done = malus("renoise", *names, "-m", model, "--from", 0, "--to", 12, "--kind", "nonparametric", "--black", BLACK, "--white", WHITE,
                 "--guide", *[tmp_path / "guide.npy"] * 4, "-o", tmp_path / "out")
    warned = [line for line in done.err.splitlines() if "brightest level" in line]
    assert len(warned) == 1 and "25 % of the pixels lie above" in warned[0] and "widened" in warned[0]
    ours = of_levels([np.array(Image.open(path)) for path in sorted((tmp_path / "out").iterdir())])
    truth = of_levels([taken(rng, stripes(), 12) for _ in range(4)])
    for level, mine, target in zip(LEVELS, ours, truth):
        print(level, mine.mean() - target.mean(), mine.var() / target.var(), root_jsd(mine, target))
        # 81920 samples: the mean to 1 % of a deviation, the variance to 1 %; calibration knows it to 1 % too.
        assert mine.mean() == pytest.approx(target.mean(), abs=0.05 * target.std()), level
        assert mine.var() == pytest.approx(target.var(), rel=0.05), level
        assert root_jsd(mine, target) < 0.03, level


def test_gains_between_show_every_kind_that_knows_them(malus, model):
    shown = malus("model", "show", model, "--gain", 6, "--json").json
    assert shown["kinds"] == ["physics", "gaussian", "nonparametric"]
    assert shown["gaussian"][0]["gain_db"] == shown["nonparametric"][0]["gain_db"] == shown["gains"][0]["gain_db"] == 6
    assert "kinds      physics, gaussian, nonparametric\n" in malus("model", "show", model, "--gain", 6).out
    assert malus("model", "show", model, "--gain", 12, "--json").json["kinds"] == ["physics", "gaussian", "nonparametric", "dark-frames"]


@pytest.mark.parametrize("as_float", [[], ["--float"]])
def test_signals_above_all_levels_are_said_and_drawn_as_loud_as_they_are(malus, model, tmp_path, as_float):
    np.save(tmp_path / "clean.npy", np.full((256, 256), 3000, np.float32))
    done = malus("synthesize", tmp_path / "clean.npy", "-m", model, "--kind", "nonparametric", "--gain", 0, "--frames", 3,
                 "--format", "npy", "-o", tmp_path / "out", *as_float)
    warned = [line for line in done.err.splitlines() if "brightest level" in line]
    assert len(warned) == 1 and warned[0].startswith("warning: 100 % of the pixels lie above"), done.err
    dn = np.stack([np.load(path) for path in sorted((tmp_path / "out").iterdir())]).astype(float)
    K, read = CAMERA[0]
    assert dn.var() == pytest.approx(K * 3000 + read**2, rel=0.04)
    np.save(tmp_path / "inside.npy", np.full((64, 64), 800, np.float32))
    inside = malus("synthesize", tmp_path / "inside.npy", "-m", model, "--kind", "nonparametric", "--gain", 0, "-o", tmp_path / "in")
    assert "level" not in inside.err


def test_data_sets_say_it_too(malus, model, tmp_path):
    np.save(tmp_path / "clean.npy", np.tile(np.array([800, 3000], np.float32), (80, 40)))
    (tmp_path / "plan.toml").write_text(
        f'model = "{model}"\nclean = ["clean.npy"]\n[dataset]\nsamples = 4\nshard_size = 2\npatch = 64\nratios = [1]\ngains = [0]\n'
        '[noise]\nkind = "nonparametric"\n')
    done = malus("dataset", tmp_path / "plan.toml", "-o", tmp_path / "set")
    warned = [line for line in done.err.splitlines() if "brightest level" in line]
    assert len(warned) == 1 and "50 % of the pixels lie above" in warned[0]


def test_pairs_compare_gains_by_the_models_K(malus, camera, tmp_path):
    """A camera whose second conversion gain makes four times the signal of 6 dB."""
    text = (camera / "s.toml").read_text().replace("gain_db = 12", "gain_db = 6").replace('paths = ["', f'paths = ["{camera}/')
    (tmp_path / "s.toml").write_text(text)
    malus("calibrate", tmp_path / "s.toml", "-o", tmp_path / "m.h5")
    rng = np.random.default_rng(5)
    scene = np.repeat(np.linspace(100, 3000, 128)[None], 128, 0)  # DN at 0 dB
    for n in range(4):
        Image.fromarray(taken(rng, scene, 0)).save(tmp_path / f"long_{n}.png")
        light = (0.8, 1.0, 0.9, 1.1)[n]
        Image.fromarray(taken(rng, scene * 4 / 20 * light, 12)).save(tmp_path / f"short_{n}.png")
    groups = "".join(f'[[frames]]\nkind = "{kind}"\ngain_db = {gain}\nexposure_s = {exposure}\npaths = ["{stem}_*.png"]\n'
                     for kind, gain, exposure, stem in (("reference", 0, 0.1, "long"), ("short", 6, 0.005, "short")))
    (tmp_path / "p.toml").write_text(text[:text.index("[[frames]]")] + groups)
    (pair,) = malus("pairs", tmp_path / "p.toml", "--model", tmp_path / "m.h5", "-o", tmp_path / "out", "--json").json["pairs"]
    assert pair["ratio"] == pytest.approx(5, rel=0.02) and pair["source"].endswith("short_1.png")
    (pair,) = malus("pairs", tmp_path / "p.toml", "-o", tmp_path / "plain", "--json").json["pairs"]
    assert pair["ratio"] == pytest.approx(20 / 10 ** (6 / 20))


def test_gains_that_are_warned_of_in_the_same_words_share_a_line(malus, tmp_path):
    rng = np.random.default_rng(5)
    text = f'[sensor]\nlayout = "mono"\nblack = {BLACK}\nwhite = {WHITE}\nrow_group = 1\n'
    for gain in CAMERA:
        for n in range(6):
            Image.fromarray(taken(rng, np.zeros((64, 64)), gain)).save(tmp_path / f"bias_{gain}_{n}.png")
        text += f'[[frames]]\nkind = "bias"\nexposure_s = 0\ngain_db = {gain}\npaths = ["bias_{gain}_*.png"]\n'
    (tmp_path / "s.toml").write_text(text)
    done = malus("calibrate", tmp_path / "s.toml", "-o", tmp_path / "m.h5", "--report", tmp_path / "r.html", "--json")
    told = [line for line in done.err.splitlines() if "no flat frames at this gain" in line]
    assert told == ["warning: 0 dB, 12 dB: no flat frames at this gain: K is not known"], done.err
    assert (tmp_path / "r.html").read_text().count("no flat frames at this gain") == 1
    for gain in done.json["gains"]:  # each gain keeps its own
        assert sum("no flat frames" in line for line in gain["warnings"]) == 1
