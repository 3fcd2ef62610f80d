"""Stacks: files that hold several frames, TIFF pages, .npy of (frame, row, column) and FITS cubes, give what their frames give in files of their own."""

import struct
import tarfile

import numpy as np
import pytest
from PIL import Image

FLATS, BLACK = 5, 80
LEVELS = ["--layout", "mono", "--black", BLACK, "--white", "4095"]


def save_fits(path, frames):
    axes = frames.shape[::-1]
    cards = ["SIMPLE  = T", "BITPIX  = 16", f"NAXIS   = {len(axes)}", *(f"NAXIS{i + 1}  = {n}" for i, n in enumerate(axes)), "BZERO   = 32768", "END"]
    head = "".join(card.ljust(80) for card in cards).ljust(2880).encode()
    data = (frames.astype(np.int32) - 32768).astype(">i2").tobytes()
    path.write_bytes(head + data + b"\0" * (-len(data) % 2880))


def save_pages(path, frames, **options):
    pages = [Image.fromarray(frame) for frame in frames]
    pages[0].save(path, save_all=True, append_images=pages[1:], **options)


def save_stack(path, frames):
    if path.suffix == ".npy":
        np.save(path, frames)
    elif path.suffix == ".fits":
        save_fits(path, frames)
    else:
        save_pages(path, frames, compression="tiff_adobe_deflate" if "deflate" in path.name else None)
    return path


def noisy(rng, light, count):
    dn = BLACK + 0.5 * rng.poisson(light / 0.5, (count, 64, 64)) + rng.normal(0, 3, (count, 64, 64))
    return np.clip(np.round(dn), 0, 4095).astype(np.uint16)


@pytest.fixture(scope="module")
def frames():
    rng = np.random.default_rng(11)
    return {"bias": noisy(rng, 0, 9), **{f"flat{i}": noisy(rng, 300 * i, 2) for i in range(1, FLATS + 1)}}


def write_session(folder, paths_of):
    """paths_of(name): the paths of a set, as TOML."""
    text = f'[sensor]\nname = "stacks"\nlayout = "mono"\nblack = {BLACK}\nwhite = 4095\nrow_group = 1\n'
    text += f'[[frames]]\nkind = "bias"\ngain_db = 0\nexposure_s = 0\npaths = {paths_of("bias")}\n'
    for i in range(1, FLATS + 1):
        text += f'[[frames]]\nkind = "flat"\ngain_db = 0\nexposure_s = 0.01\nlevel = {i}\npaths = {paths_of(f"flat{i}")}\n'
    (folder / "session.toml").write_text(text)
    return folder / "session.toml"


def calibrated(malus, folder, paths_of):
    run = malus("calibrate", write_session(folder, paths_of), "-o", folder / "model.h5")
    return (folder / "model.h5").read_bytes(), run.err.replace(str(folder), "")


@pytest.fixture
def singles(malus, frames, tmp_path):
    """The model of the frames, each in a file of its own, and what was said."""
    folder = tmp_path / "singles"
    folder.mkdir()
    for name, stack in frames.items():
        for k, frame in enumerate(stack):
            Image.fromarray(frame).save(folder / f"{name}_{k}.tif")
    return calibrated(malus, folder, lambda name: f'["{name}_*.tif"]')


@pytest.mark.parametrize("ending", [".tif", "_deflate.tif", ".npy", ".fits"])
def test_a_session_of_stacks_gives_the_model_of_its_frames(malus, frames, singles, tmp_path, ending):
    for name, stack in frames.items():
        save_stack(tmp_path / (name + ending), stack)
    assert calibrated(malus, tmp_path, lambda name: f'"{name}{ending}"') == singles


def test_stacks_parts_of_stacks_and_files_make_one_set(malus, frames, singles, tmp_path):
    np.save(tmp_path / "a.npy", frames["bias"][:4])
    Image.fromarray(frames["bias"][4]).save(tmp_path / "b.tif")
    save_pages(tmp_path / "c.tif", frames["bias"][5:])
    save_fits(tmp_path / "flats.fits", np.concatenate([frames[f"flat{i}"] for i in range(1, FLATS + 1)]))

    def paths_of(name):
        if name == "bias":
            return '["a.npy", "[bc].tif"]'
        first = 2 * (int(name[-1]) - 1)
        return f'["flats.fits[{first}]", "flats.fits[{first + 1}]"]'

    assert calibrated(malus, tmp_path, paths_of) == singles


def test_sessions_name_the_frame_that_is_wrong(refused, frames, tmp_path):
    stack = frames["bias"].copy()
    stack[7] = stack[2]
    np.save(tmp_path / "bias.npy", stack)
    session = tmp_path / "session.toml"
    session.write_text('[[frames]]\nkind = "bias"\npaths = "bias.npy"\n')
    line = refused("calibrate", session, "-o", tmp_path / "m.h5")
    assert f"{tmp_path}/bias.npy[7]: has the same pixels as {tmp_path}/bias.npy[2]; " in line
    session.write_text('[[frames]]\nkind = "bias"\npaths = ["bias.npy", "bias.npy[3]"]\n')
    assert "bias.npy[3] twice; name every file once" in refused("calibrate", session, "-o", tmp_path / "m.h5")
    session.write_text('[[frames]]\nkind = "bias"\npaths = ["bias.npy[9]"]\n')
    line = refused("calibrate", session, "-o", tmp_path / "m.h5")
    assert "bias.npy[9]: the file holds 9 frames; frames are counted from [0] to [8]" in line


@pytest.mark.parametrize("ending", [".tif", ".npy", ".fits"])
def test_a_stack_is_denoised_frame_by_frame(malus, frames, tmp_path, ending):
    stack = frames["flat3"]
    save_stack(tmp_path / ("s" + ending), stack)
    run = malus("denoise", tmp_path / ("s" + ending), *LEVELS, "-o", tmp_path / "out", "--json")
    assert [frame["input"] for frame in run.json["frames"]] == [str(tmp_path / f"s{ending}[{k}]") for k in (0, 1)]
    for k, frame in enumerate(stack):
        Image.fromarray(frame).save(tmp_path / f"s_{k:03}.tif")
        malus("denoise", tmp_path / f"s_{k:03}.tif", *LEVELS, "-o", tmp_path / "alone")
        one = f"s_{k:03}_denoised.tif"
        assert (tmp_path / "out" / one).read_bytes() == (tmp_path / "alone" / one).read_bytes()
    malus("denoise", tmp_path / f"s{ending}[1]", *LEVELS, "-o", tmp_path / "second")
    assert sorted(path.name for path in (tmp_path / "second").iterdir()) == ["s_001_denoised.json", "s_001_denoised.tif"]
    # The record leads back to the frame.
    malus("report", tmp_path / "out", "-o", tmp_path / "r.html")


def test_denoised_frames_never_replace_each_other_or_their_stack(refused, frames, tmp_path):
    np.save(tmp_path / "s.npy", frames["flat1"])
    np.save(tmp_path / "s_001.npy", frames["flat1"][0])
    line = refused("denoise", tmp_path / "s.npy", tmp_path / "s_001.npy", *LEVELS, "-o", tmp_path / "out")
    assert "its output" in line and "would replace that of" in line
    np.save(tmp_path / "s_000_denoised.npy", frames["flat1"])
    line = refused("denoise", tmp_path / "s.npy", tmp_path / "s_000_denoised.npy[1]", *LEVELS, "--format", "npy", "-o", tmp_path, "--force")
    assert "s_000_denoised.npy: is an input and would be replaced" in line


def test_references_and_guides_are_taken_frame_by_frame(malus, frames, tmp_path):
    np.save(tmp_path / "s.npy", frames["flat2"])
    np.save(tmp_path / "clean.npy", np.full((2, 64, 64), 600, np.float32))
    run = malus("denoise", tmp_path / "s.npy", *LEVELS, "--reference", tmp_path / "clean.npy", "-o", tmp_path / "out", "--json")
    for frame in run.json["frames"]:
        assert frame["against_reference"]["after"]["image_psnr"] > frame["against_reference"]["before"]["image_psnr"]
    run = malus("denoise", tmp_path / "s.npy", *LEVELS, "--reference", tmp_path / "clean.npy[0]", "-o", tmp_path / "out2", code=2)
    assert "one frame per RAW" in run.err


def test_frames_are_not_compared_as_one_picture_of_many_channels(malus, refused, frames, tmp_path):
    stack = np.repeat(frames["flat2"][:1], 65, axis=0)
    np.save(tmp_path / "codes.npy", stack[:5])
    np.save(tmp_path / "light.npy", stack.astype(np.float32))
    for name, last in (("codes.npy", 4), ("light.npy", 64)):
        line = refused("evaluate", "--reference", tmp_path / name, "--test", tmp_path / name)
        assert f"{name}: it holds {last + 1} frames; name one of them, from {name}[0] to {name}[{last}]" in line
    # Packed planes, and colours of whole numbers, are pictures.
    np.save(tmp_path / "planes.npy", stack[:16].astype(np.float32))
    np.save(tmp_path / "colour.npy", stack[:3])
    for name in ("planes.npy", "colour.npy"):
        malus("evaluate", "--reference", tmp_path / name, "--test", tmp_path / name)


def test_a_frame_that_no_stack_has_is_called_what_the_user_called_it(refused, frames, tmp_path):
    np.save(tmp_path / "s.npy", frames["flat2"])
    line = refused("info", tmp_path / "s.npy[99999999999999999999]")
    assert "s.npy[99999999999999999999]: the file holds 2 frames; frames are counted from [0] to [1]" in line


def test_stokes_normals_synthesize_and_renoise_take_stacks(malus, tmp_path):
    clean = np.stack([np.full((32, 32), level, np.float32) for level in (200, 400, 600)])
    np.save(tmp_path / "clean.npy", clean)
    polar = ["--layout", "polar-mono"]
    run = malus("synthesize", tmp_path / "clean.npy", *polar, "--model", "imx250mzr-simulated", "--gain", "0", "--frames", "2", "-o", tmp_path / "noisy",
                "--json")
    outputs = [frame["output"].rsplit("/", 1)[1] for frame in run.json["frames"]]
    assert outputs == [f"clean_{k:03}_{n:03}.tif" for k in range(3) for n in range(2)]
    malus("synthesize", tmp_path / "clean.npy[1]", *polar, "--model", "imx250mzr-simulated", "--gain", "0", "--first-frame", "2", "-o", tmp_path / "one")
    assert (tmp_path / "one/clean_001_000.tif").read_bytes() == (tmp_path / "noisy/clean_001_000.tif").read_bytes()
    run = malus("stokes", tmp_path / "clean.npy", *polar, "-o", tmp_path / "stokes", "--format", "npy", "--json")
    assert len(run.json["frames"]) == 3
    assert np.load(tmp_path / "stokes/clean_002_s0.npy") == pytest.approx(1200)
    malus("normals", tmp_path / "clean.npy", *polar, "-o", tmp_path / "normals")
    assert len(list((tmp_path / "normals").glob("clean_00[012]_normals.exr"))) == 3
    noisy_stack = np.stack([np.array(Image.open(tmp_path / f"noisy/clean_{k:03}_000.tif")) for k in range(3)])
    np.save(tmp_path / "noisy.npy", noisy_stack)
    malus("renoise", tmp_path / "noisy.npy", "--model", "imx250mzr-simulated", "--from", "0", "--to", "12", "--guide", tmp_path / "clean.npy",
          "-o", tmp_path / "renoised")
    assert sorted(path.name for path in (tmp_path / "renoised").iterdir()) == [f"noisy_{k:03}_renoised.tif" for k in range(3)]


def test_noise_of_stacks_is_compared(malus, refused, frames, tmp_path):
    np.save(tmp_path / "a.npy", frames["bias"][:4])
    save_fits(tmp_path / "b.fits", frames["bias"][4:])
    for k, frame in enumerate(frames["bias"]):
        np.save(tmp_path / f"f{k}.npy", frame)
    singles = [tmp_path / f"f{k}.npy" for k in range(9)]
    whole = malus("evaluate", "--noise", *LEVELS, "--reference", tmp_path / "a.npy", "--test", tmp_path / "b.fits", "--json")
    apart = malus("evaluate", "--noise", *LEVELS, "--reference", *singles[:4], "--test", *singles[4:], "--json")
    assert whole.json == apart.json
    line = refused("evaluate", "--noise", *LEVELS, "--reference", tmp_path / "a.npy", "--test", tmp_path / "a.npy[2]", tmp_path / "b.fits")
    assert "a.npy[2]: is given twice" in line


def test_pictures_of_a_stack_are_compared_one_by_one(malus, refused, frames, tmp_path):
    np.save(tmp_path / "s.npy", frames["bias"][:5])
    save_fits(tmp_path / "s.fits", frames["bias"][:5])
    for stack in (tmp_path / "s.npy", tmp_path / "s.fits"):
        line = refused("evaluate", "--reference", f"{stack}[0]", "--test", stack, "--layout", "polar-mono")
        assert f"{stack}: it holds 5 frames; name one of them, from {stack.name}[0] to {stack.name}[4]" in line
    assert f"{stack.name}[1]" in malus("evaluate", "--reference", f"{stack}[0]", "--test", f"{stack}[1]", "--layout", "polar-mono").out


def test_info_tells_how_many_frames_there_are(malus, refused, frames, tmp_path):
    stack = save_stack(tmp_path / "s.tif", frames["bias"])
    run = malus("info", stack, "--json")
    assert run.json["frames_in_file"] == 9 and run.json["file"] == f"{stack}[0]"
    assert run.json["mean"]["value"] == [pytest.approx(frames["bias"][0].mean())]
    run = malus("info", f"{stack}[8]", "--json")
    assert run.json["file"] == f"{stack}[8]" and run.json["mean"]["value"] == [pytest.approx(frames["bias"][8].mean())]
    assert "9 in the file" in malus("info", stack).out
    assert "the file holds 9 frames; frames are counted from [0] to [8]" in refused("info", f"{stack}[9]")


def test_data_sets_are_drawn_of_stacks(malus, tmp_path):
    clean = np.random.default_rng(3).uniform(100, 900, (3, 64, 64)).astype(np.float32)
    plan = 'model = "imx250mzr-simulated"\nclean = ["{}"]\n[dataset]\nsamples = 6\npatch = 16\nshard_size = 6\n'
    samples = {}
    for folder, pattern in (("stack", "clean.npy"), ("files", "clean_*.npy")):
        (tmp_path / folder).mkdir()
        if folder == "stack":
            np.save(tmp_path / folder / "clean.npy", clean)
        else:
            for k in range(3):
                np.save(tmp_path / folder / f"clean_{k}.npy", clean[k])
        (tmp_path / folder / "plan.toml").write_text(plan.format(pattern))
        malus("dataset", tmp_path / folder / "plan.toml", "-o", tmp_path / folder / "out")
        with tarfile.open(tmp_path / folder / "out/shard-000000.tar") as tar:
            samples[folder] = {name: tar.extractfile(name).read() for name in tar.getnames() if name.endswith(".npy")}
    assert len(samples["stack"]) == 12 and samples["stack"] == samples["files"]


def test_a_cut_or_damaged_stack_is_refused_with_its_page(refused, frames, tmp_path):
    whole = save_stack(tmp_path / "s.tif", frames["bias"]).read_bytes()
    (tmp_path / "cut.tif").write_bytes(whole[:len(whole) // 2])
    line = refused("denoise", tmp_path / "cut.tif", *LEVELS, "-o", tmp_path / "out")
    assert "cut.tif: the TIFF file ends before its " in line
    pages = [Image.fromarray(frame) for frame in frames["bias"][:3]] + [Image.fromarray(frames["bias"][3][:32])]
    pages[0].save(tmp_path / "sizes.tif", save_all=True, append_images=pages[1:])
    line = refused("info", tmp_path / "sizes.tif")
    assert "sizes.tif[3]: has 64x32 pixels of uint16, the frame [0] of its file 64x64 pixels of uint16; frames of one stack have one size" in line
    # The chain of pages leads back to the first one.
    data = bytearray(whole)
    at = struct.unpack_from("<I", data, 4)[0]
    links = []
    while at:
        links.append(at + 2 + 12 * struct.unpack_from("<H", data, at)[0])
        at = struct.unpack_from("<I", data, links[-1])[0]
    assert len(links) == 9
    data[links[-1]:links[-1] + 4] = data[4:8]
    (tmp_path / "ring.tif").write_bytes(data)
    assert "page 9 leads back to an earlier page" in refused("info", tmp_path / "ring.tif")
