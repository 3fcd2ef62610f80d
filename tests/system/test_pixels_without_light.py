"""Pixels that are NaN, infinite or below black: said in one line, and what comes of them; renoise within its memory."""

import numpy as np


def test_pixels_that_are_no_numbers_are_said_where_they_become_integers(malus, refused, tmp_path):
    clean = np.full((64, 64), 300, np.float32)
    clean[10, 11], clean[20, 21], clean[30, 31] = np.nan, np.inf, -np.inf
    np.save(tmp_path / "odd.npy", clean)
    np.save(tmp_path / "good.npy", np.full((64, 64), 300, np.float32))
    np.save(tmp_path / "none.npy", np.full((64, 64), np.nan, np.float32))
    camera = ["--layout", "polar-mono", "--model", "imx250mzr-simulated", "--format", "npy"]
    renoise = ["renoise", *camera, "--black", 0, "--white", 4013, "--from", 12, "--to", 24]
    said = "odd.npy: 3 pixels are NaN or infinite; as integers 0 or white"
    for n, command in enumerate((["synthesize", tmp_path / "odd.npy", *camera, "--gain", 12],
                                 [*renoise, tmp_path / "odd.npy"], [*renoise, tmp_path / "odd.npy", "--method", "naive"],
                                 [*renoise, tmp_path / "good.npy", "--guide", tmp_path / "odd.npy", "--method", "naive"])):
        result = malus(*command, "-o", tmp_path / f"{n}")
        assert result.err.count("NaN") == 1 and said in result.err, result.err
        out = np.load(next((tmp_path / f"{n}").glob("*.npy")))
        assert [out[10, 11], out[20, 21], out[30, 31]] == [0, 4095, 0], command
        floats = malus(*command, "--float", "-o", tmp_path / f"{n}float").err
        assert "odd.npy: 3 pixels are NaN or infinite; kept as read" in floats
    guided = malus(*renoise, tmp_path / "good.npy", "--guide", tmp_path / "odd.npy", "-o", tmp_path / "guided")
    assert "odd.npy: 3 pixels are NaN or infinite; no noise is added there" in guided.err
    for command in (["synthesize", tmp_path / "none.npy", *camera, "--gain", 12], [*renoise, tmp_path / "none.npy"],
                    [*renoise, tmp_path / "good.npy", "--guide", tmp_path / "none.npy"]):
        assert "none.npy: all pixels are NaN or infinite" in refused(*command, "-o", tmp_path / "out")
    assert not list(tmp_path.glob("out/*"))


def test_a_picture_that_holds_no_light_somewhere(malus, refused, tmp_path):
    """simulate's mosaic is truth: a pixel that is infinite must not be light of 65504 times white there."""
    picture = np.full((3, 64, 64), 0.5, np.float32)
    picture[0, 10, 11], picture[1, 20, 21], picture[2, 30, 31] = np.nan, np.inf, -np.inf
    np.save(tmp_path / "odd.npy", picture)
    np.save(tmp_path / "none.npy", np.full((3, 64, 64), np.nan, np.float32))
    simulate = ["simulate", "--layout", "polar-mono", "--format", "npy", "-o", tmp_path / "out"]
    assert malus(*simulate, tmp_path / "odd.npy").err == f"warning: {tmp_path}/odd.npy: 3 pixels are NaN or infinite; taken as dark\n"
    assert np.load(tmp_path / "out/odd_clean.npy").max() == 1000
    assert refused(*simulate, "--force", tmp_path / "none.npy") == f"malus: {tmp_path}/none.npy: all pixels are NaN or infinite; check how it was made"


def test_stokes_and_normals_of_pixels_without_light(malus, refused, tmp_path):
    frame = np.full((64, 64), 300, np.float32)
    np.save(tmp_path / "dark.npy", frame - 400)
    frame[10, 11], frame[20, 21] = np.nan, np.inf
    np.save(tmp_path / "odd.npy", frame)
    np.save(tmp_path / "none.npy", np.full((64, 64), np.nan, np.float32))
    camera = ["--layout", "polar-mono", "--black", "0", "--white", "4095"]
    for command in ("stokes", "normals"):
        for full in ([], ["--full"]):
            run = [command, *full, *camera, "--force", "-q", "-o", tmp_path / "out"]
            odd = malus(*run, tmp_path / "odd.npy").err
            assert "odd.npy: 2 pixels are NaN or infinite; S0, DoLP and AoLP are wrong or undefined there" in odd
            assert "saturated" not in odd and "no light" not in odd
            where = "pixels" if full else "cells"
            assert f"dark.npy: no light above black in 100 % of the {where}: DoLP and AoLP are undefined there; check --black" in \
                malus(*run, tmp_path / "dark.npy").err
            assert "none.npy: all pixels are NaN or infinite" in refused(*run, tmp_path / "none.npy")


def test_no_angle_is_made_of_an_infinite_pixel(malus, tmp_path):
    """One pixel of a cell is infinite: its S1 or S2 would point at 0, 45, 90 or 135 degrees whatever the light."""
    rows, cols = np.mgrid[0:32, 0:32]
    twice = np.radians(2 * np.array([[90, 45], [135, 0]])[rows % 2, cols % 2])
    frame = (500 * (1 + 0.4 * np.cos(np.radians(40)) * np.cos(twice) + 0.4 * np.sin(np.radians(40)) * np.sin(twice))).astype(np.float32)
    for row, col in (4, 4), (4, 9), (9, 14), (9, 21):  # 90, 45, 135, 0
        frame[row, col] = np.inf
    np.save(tmp_path / "odd.npy", frame)
    done = malus("stokes", tmp_path / "odd.npy", "--layout", "polar-mono", "--format", "npy", "--no-pictures", "--json", "-o", tmp_path).json
    aolp = np.load(tmp_path / "odd_aolp.npy")
    assert np.argwhere(np.isnan(aolp)).tolist() == [[2, 2], [2, 4], [4, 7], [4, 10]]
    assert done["aolp_undefined"] == np.isnan(aolp).mean()
    assert np.allclose(aolp[~np.isnan(aolp)], 20, atol=1e-3)


def test_a_share_of_all_pixels_is_written_as_a_percentage(malus, tmp_path):
    frame = np.zeros((32, 32), np.float32)
    frame[::2, ::2] = 100  # 90 degrees alone: DoLP 2
    np.save(tmp_path / "dark.npy", frame)
    assert ", above 1 (noise) 100 %," in malus("stokes", tmp_path / "dark.npy", "--layout", "polar-mono", "-o", tmp_path).out


def test_a_refusal_stands_alone(malus, tmp_path):
    """Without the note on the conventions of normals, or a warning of --black, before it."""
    np.save(tmp_path / "none.npy", np.full((64, 64), np.nan, np.float32))
    camera = ["--layout", "polar-mono", "--white", "4095", "--black", "82", "-o", tmp_path / "out"]
    for command in (["normals"], ["synthesize", "--model", "imx250mzr-simulated", "--gain", "12"]):
        command += [option for option in camera if command == ["normals"] or option not in ("--white", "4095")]
        assert malus(*command, tmp_path / "none.npy", code=1).err.count("\n") == 1
    np.save(tmp_path / "good.npy", np.full((64, 64), 300, np.float32))
    assert "diffuse reflection, refractive index 1.5" in malus("normals", *camera, tmp_path / "good.npy").err


def test_renoise_keeps_to_its_memory(malus, refused, tmp_path):
    """As denoise does, by tiles, which do not change a byte; a frame that does not fit is refused."""
    np.save(tmp_path / "frame.npy", np.random.default_rng(1).integers(200, 900, (1024, 1024)).astype(np.uint16))
    for name, memory in (("whole", []), ("tiles", ["--memory", 128])):
        malus("renoise", tmp_path / "frame.npy", "-m", "imx250mzr-simulated", "--from", 12, "--to", 24, *memory, "--format", "npy",
              "-o", tmp_path / name)
    assert (tmp_path / "whole/frame_renoised.npy").read_bytes() == (tmp_path / "tiles/frame_renoised.npy").read_bytes()
    assert "--memory" in malus("renoise", tmp_path / "frame.npy", "-m", "imx250mzr-simulated", "--from", 12, "--to", 24, "--memory", 1,
                               "-o", tmp_path / "out", code=2).err
    np.save(tmp_path / "large.npy", np.full((4096, 4096), 300, np.uint16))
    line = refused("renoise", tmp_path / "large.npy", "-m", "imx250mzr-simulated", "--from", 12, "--to", 24, "--memory", 128, "-o", tmp_path / "out")
    assert "128 MiB is too little" in line


def test_pixels_left_out_of_a_comparison_of_noise_are_said(malus, refused, tmp_path):
    rng = np.random.default_rng(7)
    frames = {name: rng.normal(100, 5, (64, 64)).astype(np.float32) for name in ("a", "b", "c", "clean")}
    frames["b"][3, 4] = frames["b"][5, 6] = frames["clean"][7, 8] = np.nan
    for name, dn in frames.items():
        np.save(tmp_path / f"{name}.npy", dn)
    np.save(tmp_path / "none.npy", np.full((64, 64), np.nan, np.float32))
    noise = ("evaluate", "--noise", "--reference", tmp_path / "a.npy", "--test")
    said = malus(*noise, tmp_path / "b.npy", tmp_path / "c.npy", "--clean", tmp_path / "clean.npy").err
    assert said.count("b.npy: 2 pixels are NaN or infinite; left out") == 1  # though it is loaded more than once
    assert "clean.npy: 1 pixel is NaN or infinite; left out" in said and said.count("left out") == 2
    assert "left out" not in malus(*noise, tmp_path / "c.npy").err
    frames["c"][0, 0] = np.inf
    np.save(tmp_path / "c.npy", frames["c"])
    both = malus(*noise, tmp_path / "b.npy", tmp_path / "c.npy").err  # of many frames one line, too
    assert both.count("left out") == 1 and "b.npy and 1 more frame: 3 pixels are NaN or infinite; left out" in both
    assert "none.npy: all pixels are NaN or infinite" in refused(*noise, tmp_path / "none.npy")
