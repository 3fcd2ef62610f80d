"""What a report shows of several gains: correlations between channels, and curves over gain."""

import json
import re

import numpy as np
import pytest

from test_report import page_data
from test_report_runs import charts_of

BLACK, WHITE = 100, 4095


@pytest.fixture(scope="module")
def bias_of_four_gains(malus, tmp_path_factory):
    """Bias frames with no row noise; their level is steady, or rises and falls for all channels at once."""
    folder = tmp_path_factory.mktemp("gains")
    rng = np.random.default_rng(3)

    def made(name, drift_dn):
        text = f'[sensor]\nlayout = "bayer-rggb"\nblack = {BLACK}\nwhite = {WHITE}\n'
        (folder / name).mkdir()
        for gain_db in (0, 6, 12, 24):
            K_here, read_dn = 0.25 * 10 ** (gain_db / 20), 0.6 + 0.4 * 10 ** (gain_db / 20)
            for kind, level, count in (("bias", 0, 20), *(("flat", 2000 * (i + 1), 2) for i in range(4))):
                for n in range(count):
                    light = rng.poisson(level / 10 ** (gain_db / 20), (64, 64)) * K_here
                    dn = BLACK + 0.3 + drift_dn * rng.normal() + light + rng.normal(0, read_dn, (64, 64))
                    np.save(folder / name / f"{kind}_{gain_db}_{level}_{n:02}.npy", np.clip(np.round(dn), 0, WHITE).astype(np.uint16))
                text += f'[[frames]]\nkind = "{kind}"\ngain_db = {gain_db}\nlevel = {level // 2000}\n' \
                        f'paths = ["{name}/{kind}_{gain_db}_{level}_*.npy"]\n'
        (folder / f"{name}.toml").write_text(text)
        malus("calibrate", folder / f"{name}.toml", "-o", folder / f"{name}.h5", "--report", folder / f"{name}.html")
        return page_data(folder / f"{name}.html"), folder / f"{name}.h5"

    return {"steady": made("steady", 0), "drifting": made("drifting", 1)}


def cells_of(page, title):
    return [np.array(chart["series"][0]["cells"], float) for chart in charts_of(page, title)]


def test_correlations_are_empty_where_nothing_changes(bias_of_four_gains):
    """Of frames that differ by sampling error alone, +-1 was shown between all channels."""
    steady, drifting = bias_of_four_gains["steady"][0], bias_of_four_gains["drifting"][0]
    for title in ("Correlation of μ", "Correlation of σ_b", "Correlation of row offsets"):
        cells = cells_of(steady, title)
        assert len(cells) == 4 and np.mean(np.isnan(cells)) > 0.9, cells
    assert min(cells.min() for cells in cells_of(drifting, "Correlation of μ")) > 0.9
    assert all(len(chart["series"]) == 3 for chart in charts_of(drifting, "μ of R against"))
    assert {len(chart["series"]) for chart in charts_of(steady, "μ of R against")} & {1}
    assert all("Over 20 bias frames" in chart["text"] for chart in charts_of(steady, "Correlation of μ"))


@pytest.mark.parametrize("title, name, sign", [("Read noise scale σ_TL over gain", "sigma_tl", 1), ("Negative bias", "mu", -1)])
def test_curves_over_gain_are_what_the_model_gives(malus, bias_of_four_gains, title, name, sign):
    page, model = bias_of_four_gains["steady"]
    (chart,) = charts_of(page, title)
    curve = next(series for series in chart["series"] if series["name"] == "R, model")
    for gain_db in (3, 9, 18):
        at = json.loads(malus("model", "show", model, "--gain", gain_db, "--json").out)["gains"][0]
        drawn = np.interp(np.log(np.mean(at["K"]["value"])), np.log(curve["x"]), curve["y"])
        assert drawn == pytest.approx(sign * at[name]["mean"][0], rel=0.005, abs=0.002)


def test_the_text_of_a_model_says_of_what_its_lines_over_gain_are(malus, bias_of_four_gains):
    """A bias that is no power of K is fitted itself; the table called it a logarithm."""
    text = malus("model", "show", bias_of_four_gains["steady"][1]).out
    assert "y = slope log K + intercept" in text
    assert re.search(r"^ +-mu( +-?[\d.]+){3}$", text, re.M) and "log(-mu)" not in text
    assert re.search(r"^ +log\(sigma_TL\)( +-?[\d.]+){3}$", text, re.M)
    assert "log(-mu)" in malus("model", "show", "imx250myr-simulated").out
