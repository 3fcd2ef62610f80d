"""malus capture against Aravis' fake cameras: in the process, and as a GigE Vision camera on the loopback interface.

The fake camera draws a ramp that moves by one step with every frame: pixel (0, 0) counts frames modulo 256, so that lost and
doubled frames can be seen in the pictures themselves.
"""

import ctypes
import json
import os
import shutil
import signal
import subprocess
import time
import tomllib
import uuid

import numpy as np
import pytest
from PIL import Image

from conftest import BUILD, PROGRAM, ROOT

pytestmark = [pytest.mark.slow, pytest.mark.alone, pytest.mark.skipif(not (BUILD / "libmalus_capture.a").exists(), reason="built without capture (Aravis is missing)")]

PLAN = """
[sensor]
name = "fake"
layout = "mono"
black = 0
[camera]
id = "{camera}"
width = 128
height = 64
[[capture]]
kind = "bias"
gain_db = 0
exposure_s = 0.01
frames = {frames}
"""
STEP = "bias/g0/e0.01"


@pytest.fixture
def plan(tmp_path):
    def write(frames, camera="Fake_1", more=""):
        path = tmp_path / "plan.toml"
        path.write_text(PLAN.format(camera=camera, frames=frames) + more)
        return path

    return write


def pictures(folder):
    return sorted((folder / STEP).iterdir())


def mean_dn(folder):
    return np.mean([np.asarray(Image.open(path)) for path in folder.rglob("f*.tif")])


def ramp(paths):
    corner = np.array([np.asarray(Image.open(path))[0, 0] for path in paths], dtype=int)
    return (corner + 1) // 256


def steps(paths):
    return np.diff(ramp(paths)) % 256


def test_list_shows_the_camera_and_its_formats(malus):
    cameras = {camera["id"]: camera for camera in malus("capture", "--list", "--json").json["cameras"]}
    assert {"Mono8", "Mono16"} <= set(cameras["Fake_1"]["pixel_formats"])
    assert "Fake_1" in malus("capture", "--list").out


def test_live_check_is_what_the_frames_hold(malus, plan, tmp_path):
    bright = '[[capture]]\nkind = "flat"\ngain_db = 6\nexposure_s = 0.02\nframes = 6\n'
    done = malus("capture", plan(12, more=bright), "-o", tmp_path / "out", "--json")
    for step in done.json["steps"]:
        frames = [np.asarray(Image.open(path)).astype(float) for path in sorted((tmp_path / "out" / step["folder"]).iterdir())]
        assert step["mean_dn"] == pytest.approx(np.mean(frames), rel=1e-6)
        assert step["saturated_share"] == pytest.approx(np.mean(np.array(frames) >= 65535))
        differences = [np.var(a - b) / 2 for a, b in zip(frames, frames[1:])]
        assert step["temporal_sd_dn"] == pytest.approx(np.sqrt(np.mean(differences)), rel=1e-6)
    assert done.json["steps"][1]["saturated_share"] > 0.5
    assert "flat/g6" in done.err and "saturated" in done.err and "bias" not in done.err


def test_live_check_is_shown_on_a_terminal(plan, tmp_path):
    ours, terminal = os.openpty()
    with subprocess.Popen([PROGRAM, "capture", plan(2500), "-o", tmp_path / "out"], stdout=subprocess.DEVNULL, stderr=terminal):
        os.close(terminal)
        shown = b""
        while True:
            try:
                shown += os.read(ours, 4096)
            except OSError:  # its other end is closed
                break
    os.close(ours)
    lines = shown.decode().split("\r")
    assert any("bias 0 dB 0.01 s [" in line and "mean " in line and "saturated 0.00 %, lost 0" in line for line in lines)


def test_from_camera_to_report(malus, plan, tmp_path):
    flats = '[[capture]]\nkind = "flat"\ngain_db = 0\nexposure_s = [0.002, 0.004, 0.006, 0.008]\nframes = 4\n'
    path = plan(10, more=flats)
    path.write_text(path.read_text().replace("exposure_s = 0.01\n", "exposure_s = 0.0011\n"))
    command = f"{PROGRAM} capture {path} -o {tmp_path}/out && " \
              f"{PROGRAM} calibrate {tmp_path}/out/session.toml -o {tmp_path}/model.h5 --report {tmp_path}/report.html"
    done = subprocess.run(command, shell=True, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    shown = malus("model", "show", tmp_path / "model.h5", "--json").json
    (gain,) = shown["gains"]
    assert (shown["sensor"], gain["frames"], gain["flat_levels"]) == ("fake", 10, 4)
    # The ramp has no photon noise: what K it gives depends on the frame it starts with, and may be none. Its light is known.
    dark_dn = gain["mu"]["mean"][0]
    assert dark_dn == pytest.approx(mean_dn(tmp_path / "out/bias"), rel=0.02)
    assert gain["photon_transfer"]["exposure_s"] == [0.002, 0.004, 0.006, 0.008]
    levels = [mean_dn(folder) - dark_dn for folder in sorted((tmp_path / "out/flat/g0").iterdir())]
    assert gain["photon_transfer"]["mean_dn"] == pytest.approx(levels, rel=1e-6)
    assert "<html" in (tmp_path / "report.html").read_text()[:2000]


def test_the_plan_of_the_documentation_is_taken(malus, tmp_path):
    text = (ROOT / "docs/capture.md").read_text().split("```toml")[1].split("```")[0]
    before, camera = text.split("[camera]")
    _, captures = camera.split("[[capture]]", 1)
    # The documentation's camera is a real one: the fake one takes its place, with its own range of gains.
    captures = captures.replace("[0, 12, 24]", "[0, 5, 10]")
    path = tmp_path / "plan.toml"
    path.write_text(before + '[camera]\nid = "Fake_1"\nwidth = 32\nheight = 32\nsettle_frames = 0\n[[capture]]' + captures)
    done = malus("capture", path, "-o", tmp_path / "out", "--json")
    taken = [step["taken"] for step in done.json["steps"]]
    assert taken == [100] * 3 + [4] * 15
    assert done.err.count("Cover the lens") == 1 and done.err.count("evenly lit") == 1


def check_complete(folder, frames, report):
    paths = pictures(folder)
    assert [path.name for path in paths] == [f"f{i + 1:06d}.tif" for i in range(frames)]
    assert report["steps"][0]["taken"] + report["steps"][0]["kept"] == frames
    session = tomllib.loads((folder / "session.toml").read_text())
    assert session["frames"][0]["paths"] == [f"{STEP}/{path.name}" for path in paths]
    assert np.asarray(Image.open(paths[-1])).shape == (64, 128)


def run_and_end(plan, folder, frames, how):
    """Starts a capture and ends it once `frames` frames lie in the folder; returns those up to the first gap."""
    process = subprocess.Popen([PROGRAM, "capture", plan, "-o", folder], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    while not (folder / STEP).exists() or len(list((folder / STEP).glob("f*.tif"))) < frames:
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.002)
    process.send_signal(how)
    process.communicate()
    whole = [path for i, path in enumerate(sorted((folder / STEP).glob("f*.tif"))) if path.name == f"f{i + 1:06d}.tif"]
    return process.returncode, {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in whole}


def test_killed_again_and_again_nothing_is_lost_or_doubled(malus, plan, tmp_path):
    path, folder = plan(700), tmp_path / "out"
    kept = {}
    for frames in (50, 200, 400):
        code, whole = run_and_end(path, folder, frames, signal.SIGKILL)
        assert code == -signal.SIGKILL and len(whole) >= len(kept)
        assert all(whole[old] == content for old, content in kept.items())
        kept = whole
    report = malus("capture", path, "-o", folder, "--json").json
    check_complete(folder, 700, report)
    assert report["steps"][0]["kept"] >= 390
    assert all((old.stat().st_mtime_ns, old.read_bytes()) == content for old, content in kept.items())
    # Within each run the camera's count goes on without a gap: only the four runs' seams differ.
    assert np.count_nonzero(steps(pictures(folder)) != 1) <= 3


def test_stopped_by_the_user_and_continued(malus, plan, tmp_path):
    frames = 3000  # more than a busy machine takes until the signal arrives
    path, folder = plan(frames), tmp_path / "out"
    code, _ = run_and_end(path, folder, 100, signal.SIGINT)
    assert code == -signal.SIGINT and not (folder / "session.toml").exists()
    check_complete(folder, frames, malus("capture", path, "-o", folder, "--json").json)


def test_what_was_not_measured_is_no_number(malus, plan, tmp_path):
    """A single frame has no difference; a step that is complete is not taken again."""
    command = "capture", plan(1), "-o", tmp_path / "out"
    (step,) = malus(*command, "--json").json["steps"]
    assert step["taken"] == 1 and step["mean_dn"] > 0 and step["temporal_sd_dn"] is None and step["saturated_share"] == 0
    (step,) = malus(*command, "--json").json["steps"]
    assert (step["taken"], step["kept"]) == (0, 1)
    assert step["mean_dn"] is step["temporal_sd_dn"] is step["saturated_share"] is None
    line = malus(*command).out.splitlines()[2]
    assert line.split() == [STEP, "0", "1", "0", "-", "-", "-"]


def test_stopped_where_it_waits_for_the_user(plan, tmp_path):
    path = plan(5)
    path.write_text(path.read_text() + 'prompt = "Cover the lens"\n')
    ours, terminal = os.openpty()
    with subprocess.Popen([PROGRAM, "capture", path, "-o", tmp_path / "out"], stdin=terminal, stdout=subprocess.DEVNULL,
                          stderr=subprocess.PIPE, text=True) as process:
        said = ""
        while "Press Enter when ready" not in said:
            more = process.stderr.read(1)
            assert more, said
            said += more
        process.send_signal(signal.SIGINT)
        try:
            assert process.wait(timeout=20) == -signal.SIGINT
        finally:
            process.kill()
    os.close(ours)
    os.close(terminal)
    assert not (tmp_path / "out" / STEP).exists()


def test_without_a_terminal_nobody_is_asked_and_that_is_said(malus, plan, tmp_path):
    path = plan(5)
    path.write_text(path.read_text() + 'prompt = "Cover the lens"\n')
    told = malus("capture", path, "-o", tmp_path / "out", "-q", stdin=subprocess.DEVNULL).err
    assert told == 'warning: "Cover the lens": no terminal to answer on, the frames are taken at once\n'
    assert len(pictures(tmp_path / "out")) == 5
    assert not malus("capture", path, "-o", tmp_path / "out", "-q", stdin=subprocess.DEVNULL).err  # nothing is left to take


def test_what_the_camera_cannot_do_is_refused_before_the_first_frame(refused, plan, tmp_path):
    path = plan(5, more='[[capture]]\nkind = "flat"\ngain_db = 600\nexposure_s = 0.01\nframes = 5\n')
    assert "600 dB" in refused("capture", path, "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()  # the corrected plan may have the same folder
    path.write_text(path.read_text().replace("[camera]", '[camera]\npixel_format = "Mono12p"').replace("600", "0"))
    assert "Mono12p" in refused("capture", path, "-o", tmp_path / "other")


@pytest.fixture
def network_camera():
    """network_camera(*options) starts a GigE Vision camera on the loopback interface; returns its id and process."""
    program = shutil.which("arv-fake-gv-camera-0.8")
    if program is None:
        pytest.skip("needs arv-fake-gv-camera-0.8 (aravis-tools)")
    started = []

    def start(*options, serial=None):
        serial = serial or "M" + uuid.uuid4().hex[:8]
        process = subprocess.Popen([program, "-i", "127.0.0.1", "-s", serial, *options], stdout=subprocess.DEVNULL,
                                   stderr=subprocess.DEVNULL)
        started.append(process)
        for _ in range(10):
            listed = subprocess.run([PROGRAM, "capture", "--list", "--json"], capture_output=True, text=True).stdout
            if serial in listed:
                return f"Aravis-Fake-{serial}", serial, process
            if process.poll() is not None:
                break
        pytest.skip("the fake GigE Vision camera does not run here (loopback interface)")

    yield start
    for process in started:
        process.kill()
        process.wait()


def fake_description():
    """What the fake camera tells of its features (GenICam XML), with its bounds as fixed numbers."""
    library = ctypes.CDLL("libaravis-0.8.so.0")
    library.arv_fake_camera_new.restype = library.arv_fake_camera_get_genicam_xml.restype = ctypes.c_void_p
    library.arv_fake_camera_get_genicam_xml.argtypes = [ctypes.c_void_p, ctypes.POINTER(ctypes.c_size_t)]
    size = ctypes.c_size_t()
    text = library.arv_fake_camera_get_genicam_xml(library.arv_fake_camera_new(b"X"), ctypes.byref(size))
    return ctypes.string_at(text, size.value).decode()


def bound_camera(tmp_path, rate_follows):
    """A description of the fake camera whose exposure ends 100 us before its frame does, as on many cameras. Its highest rate is that at
    its exposure, or is the same always: then the exposure gives way to the rate."""
    text = fake_description()
    swaps = {
        "<Min>10.0</Min>\n\t\t<Max>10000000.0</Max>": "<Min>10.0</Min>\n\t\t<pMax>AcquisitionFramePeriod</pMax>",
        "<FormulaTo>FROM</FormulaTo>\n\t\t<FormulaFrom>TO</FormulaFrom>\n\t\t<pValue>ExposureTimeAbsRegister</pValue>":
            '<pVariable Name="P">AcquisitionFramePeriodRegister</pVariable>\n'
            "\t\t<FormulaTo>(FROM &gt; (P - 100)) ? (P - 100) : FROM</FormulaTo>\n"
            "\t\t<FormulaFrom>(TO &gt; (P - 100)) ? (P - 100) : TO</FormulaFrom>\n"
            "\t\t<pValue>ExposureTimeAbsRegister</pValue>",
    }
    if rate_follows:
        swaps["<Min>1000</Min>\n\t  <Max>10000000</Max>\n\t</Integer>"] = (
            "<pMin>ShortestFramePeriod</pMin>\n\t  <Max>10000000</Max>\n\t</Integer>\n"
            '\t<IntSwissKnife Name="ShortestFramePeriod" NameSpace="Custom">\n'
            '\t\t<pVariable Name="E">ExposureTimeAbsRegister</pVariable>\n'
            "\t\t<Formula>(E &gt; 900) ? (E + 100) : 1000</Formula>\n\t</IntSwissKnife>")
    for old, new in swaps.items():
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path = tmp_path / "bound.xml"
    path.write_text(text)
    return "-g", str(path)


EXPOSURES = "[0.0005, 0.005, 0.01, 0.02]"


def flats(plan, camera, rate=""):
    path = plan(2, camera)
    path.write_text(path.read_text().replace("[[capture]]", f"settle_frames = 0\n{rate}\n[[capture]]") +
                    f'[[capture]]\nkind = "flat"\ngain_db = 0\nexposure_s = {EXPOSURES}\nframes = 2\n')
    return path


@pytest.mark.slow
def test_exposures_are_the_plans_where_a_frames_length_bounds_them(malus, plan, tmp_path, network_camera):
    """Without a rate in the plan the camera's highest was set before the exposures, which it shortened to 0.0009 s."""
    camera, _, _ = network_camera(*bound_camera(tmp_path, rate_follows=True))
    report = malus("capture", flats(plan, camera), "-o", tmp_path / "out", "--json").json
    session = tomllib.loads((tmp_path / "out/session.toml").read_text())
    assert [group["exposure_s"] for group in session["frames"]] == pytest.approx([0.01, 0.0005, 0.005, 0.01, 0.02])
    rates = [step["frame_rate_hz"] for step in report["steps"]]
    assert rates == pytest.approx([99, 1000, 196, 99, 49.75], rel=0.01)
    assert report["frame_rate_hz"] == max(rates)


@pytest.mark.slow
def test_settings_that_the_camera_takes_otherwise_are_refused(refused, malus, plan, tmp_path, network_camera):
    camera, _, _ = network_camera(*bound_camera(tmp_path, rate_follows=False))
    path = flats(plan, camera, "frame_rate_hz = 500")
    told = refused("capture", path, "-o", tmp_path / "out")
    assert "asks for an exposure of 0.01 s, the camera takes 0.0019 s at 500 frames per second; lower frame_rate_hz" in told
    assert "give a lower frame_rate_hz" in refused("capture", flats(plan, camera), "-o", tmp_path / "out")
    path = flats(plan, camera, "frame_rate_hz = 40")
    path.write_text(path.read_text().replace('"flat"\ngain_db = 0', '"flat"\ngain_db = 5.5'))
    assert "asks for a gain of 5.5 dB, the camera takes 5 dB; give a gain that it has" in refused("capture", path, "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()
    malus("capture", flats(plan, camera, "frame_rate_hz = 40"), "-o", tmp_path / "out")
    session = tomllib.loads((tmp_path / "out/session.toml").read_text())
    assert session["frames"][-1]["exposure_s"] == pytest.approx(0.02)


@pytest.mark.slow
def test_network_camera_loses_nothing_unsaid(malus, plan, tmp_path, network_camera):
    """At 1000 frames/s a machine that is busy otherwise may lose some (the kernel holds 13 of them): then it is said."""
    camera, _, _ = network_camera()
    report = malus("capture", plan(1500, camera), "-o", tmp_path / "out", "--json").json
    check_complete(tmp_path / "out", 1500, report)
    skipped = int(np.sum(steps(pictures(tmp_path / "out")) - 1))
    assert skipped <= report["steps"][0]["lost"] <= skipped + 3 and skipped < 150


@pytest.mark.slow
def test_lost_frames_are_taken_again_and_counted(malus, plan, tmp_path, network_camera):
    """A link that loses 2 % of its packets: what is reported is what the ramp of the kept frames skips."""
    camera, _, _ = network_camera("-r", "20")
    done = malus("capture", plan(200, camera), "-o", tmp_path / "out", "--json")
    check_complete(tmp_path / "out", 200, done.json)
    skipped = int(np.sum(steps(pictures(tmp_path / "out")) - 1))
    assert skipped > 10
    # Frames lost before the first kept one was seen belong to no gap between kept ones.
    assert skipped <= done.json["steps"][0]["lost"] <= skipped + 3
    assert "lost on the way and taken again" in done.err


@pytest.mark.slow
def test_a_camera_that_goes_away_is_named_and_the_rest_taken_later(malus, plan, tmp_path, network_camera):
    camera, serial, process = network_camera()
    path, folder = plan(800, camera), tmp_path / "out"
    running = subprocess.Popen([PROGRAM, "capture", path, "-o", folder], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    while not (folder / STEP).exists() or len(list((folder / STEP).iterdir())) < 100:
        assert running.poll() is None, running.stderr.read()
        time.sleep(0.005)
    process.kill()
    _, said = running.communicate(timeout=60)
    assert running.returncode == 1 and "no frame came" in said and said.count("\n") == 1
    network_camera(serial=serial)
    report = malus("capture", path, "-o", folder, "--json").json
    assert report["steps"][0]["kept"] >= 100
    check_complete(folder, 800, report)


def peak_memory_kb(arguments, stdout):
    with open(stdout, "w") as out:
        process = subprocess.Popen([PROGRAM, *map(str, arguments)], stdout=out)
        _, status, usage = os.wait4(process.pid, 0)
    assert status == 0
    return usage.ru_maxrss


@pytest.mark.slow
def test_ten_thousand_frames_at_full_rate(plan, tmp_path):
    """None lost, none doubled, in memory that does not grow."""
    peak_kb = {}
    for frames in (1000, 10000):
        folder, out = tmp_path / str(frames), tmp_path / f"{frames}.json"
        peak_kb[frames] = peak_memory_kb(["capture", plan(frames), "-o", folder, "--json"], out)
    report = json.loads(out.read_text())
    assert report["frame_rate_hz"] >= 1000 and report["steps"][0]["lost"] == 0
    check_complete(folder, 10000, report)
    assert set(steps(pictures(folder))) == {1}
    assert peak_kb[10000] < peak_kb[1000] + 40_000  # 10000 frames of 16 kB are 160 MB
