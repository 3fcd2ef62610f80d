"""malus info, and how every command that takes RAW answers bad input."""

import json
import os
import struct

import numpy as np
import pytest


def save(path, array):
    np.save(path, array)
    return path


def noisy_polar_mosaic(rows=128, cols=160):
    """[90 45; 135 0] of a scene with DoLP 0.5 and AoLP 20 degrees, black 64, noise sd 5."""
    rng = np.random.default_rng(1)
    s0 = 800 + 200 * np.sin(np.arange(cols) / 40)[None, :] + np.zeros((rows, 1))
    angles = np.tile([[90, 45], [135, 0]], (rows // 2, cols // 2))
    light = s0 / 2 * (1 + 0.5 * np.cos(2 * np.deg2rad(angles - 20)))
    return np.rint(64 + light + rng.normal(0, 5, (rows, cols))).astype(np.uint16)


def test_numbers(malus, tmp_path):
    mosaic = noisy_polar_mosaic(320, 320)
    mosaic[0, 0] = 4095
    file = save(tmp_path / "a.npy", mosaic)
    found = malus("info", "--json", file, "--layout", "polar-mono", "--black", 64, "--white", 4095,
                  "--gain", 12, "--exposure", 0.02).json
    assert (found["rows"], found["cols"], found["bits"]) == (320, 320, 16)
    assert found["channels"] == ["90", "45", "135", "0"]
    assert found["gain_db"] == 12 and found["iso"] is None and found["exposure_s"] == 0.02
    for channel, (r, c) in enumerate([(0, 0), (0, 1), (1, 0), (1, 1)]):
        assert found["mean"]["value"][channel] == pytest.approx(mosaic[r::2, c::2].mean(), rel=1e-9)
        assert found["noise_sd"]["value"][channel] == pytest.approx(5, rel=0.1)
        assert found["noise_sd_at"]["value"][channel] == pytest.approx(found["mean"]["value"][channel], rel=0.1)
    assert found["saturated_share"]["value"][0] == pytest.approx(1 / 160**2)
    check = found["layout_check"]
    assert check["decided"] and check["winner"] == check["declared"] == "diagonal"
    assert found["warnings"] == []


def test_a_wrong_layout_is_seen(malus, tmp_path):
    mosaic = noisy_polar_mosaic()
    file = save(tmp_path / "a.npy", mosaic[:, 1:-1])  # columns shifted by one: still diagonal pairs
    assert malus("info", "--json", file, "--layout", "polar-mono").json["layout_check"]["winner"] == "diagonal"
    rows = mosaic.reshape(64, 2, 160)
    shuffled = rows.copy()
    shuffled[:, 1, 0::2], shuffled[:, 1, 1::2] = rows[:, 1, 1::2], rows[:, 1, 0::2]
    file = save(tmp_path / "b.npy", shuffled.reshape(128, 160))
    result = malus("info", file, "--layout", "polar-mono", "--black", 64)
    assert "warning:" in result.err and "is the layout right" in result.err
    assert "NOT as declared" in result.out


def test_levels_that_the_pixels_contradict_are_reported(malus, tmp_path):
    eight = save(tmp_path / "eight.npy", (noisy_polar_mosaic() >> 4).astype(np.uint8))
    assert "its 8 bits do not reach the white level, check --white" in malus("info", "--json", eight, "--white", 4095).json["warnings"]


def test_scaled_values_and_nan_are_reported(malus, tmp_path):
    shifted = save(tmp_path / "shifted.npy", noisy_polar_mosaic() * 16)
    found = malus("info", "--json", shifted).json
    assert found["value_grid"] == {"step": 16, "offset": 0, "spread": 0}
    assert "all values are multiples of 16: " in found["warnings"][0] and "scaled up" in found["warnings"][0]
    holes = noisy_polar_mosaic().astype(np.float32)
    holes[3, 4:7] = [np.nan, np.inf, -np.inf]
    found = malus("info", "--json", save(tmp_path / "nan.npy", holes)).json
    assert found["nonfinite_pixels"] == 3
    assert "3 pixels are NaN or infinite" in found["warnings"][0]


def test_several_files(malus, tmp_path):
    files = [save(tmp_path / f"{n}.npy", noisy_polar_mosaic()) for n in "ab"]
    assert [f["file"] for f in malus("info", "--json", *files).json["frames"]] == [str(f) for f in files]


def test_packed_formats(malus, tmp_path):
    values = np.arange(64 * 48).reshape(48, 64) % 4096
    pairs = values.reshape(-1, 2)
    lsb = np.stack([pairs[:, 0] & 255, (pairs[:, 0] >> 8) | ((pairs[:, 1] & 15) << 4), pairs[:, 1] >> 4], 1)
    gige = np.stack([pairs[:, 0] >> 4, (pairs[:, 0] & 15) | ((pairs[:, 1] & 15) << 4), pairs[:, 1] >> 4], 1)
    for name, data in (("mono12p", lsb), ("mono12packed", gige), ("mono16", values.astype("<u2"))):
        file = tmp_path / f"{name}.raw"
        file.write_bytes(data.astype("u1").tobytes() if name != "mono16" else data.tobytes())
        found = malus("info", "--json", file, "--raw-format", name, "--size", "64x48").json
        assert found["mean"]["value"][0] == pytest.approx(values.mean())
        assert found["maximum"]["value"][0] == values.max()


def test_a_session_describes_the_frames(malus, refused, tmp_path):
    save(tmp_path / "a.npy", noisy_polar_mosaic())
    session = tmp_path / "s.toml"
    session.write_text('[sensor]\nlayout = "polar-mono"\nblack = 64\nwhite = 4095\nsize = "160x128"\n'
                       '[[frames]]\nkind = "flat"\npaths = ["a.npy"]\n')
    found = malus("info", "--json", tmp_path / "a.npy", "--session", session, "--black", 60).json
    assert (found["layout"], found["black"][0], found["white"]) == ("polar-mono", 60, 4095)
    save(tmp_path / "small.npy", noisy_polar_mosaic(64, 64))
    assert "64x64" in refused("info", tmp_path / "small.npy", "--session", session)
    session.write_text(session.read_text().replace("kind", "knid"))
    line = refused("info", tmp_path / "a.npy", "--session", session)
    assert '"knid"' in line and 'did you mean "kind"' in line


def png(rows, cols, value=0):
    import zlib

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    line = b"\0" + struct.pack(">H", value) * cols
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", cols, rows, 16, 0, 0, 0, 0))
            + chunk(b"IDAT", zlib.compress(line * rows)) + chunk(b"IEND", b""))


def test_bad_files_give_one_line(refused, misused, malus, tmp_path):
    good = png(32, 48, 700)
    file = tmp_path / "a.png"
    file.write_bytes(good)
    assert malus("info", "--json", file).json["mean"]["value"] == [700]
    for length in (0, 1, 8, 40, len(good) // 2, len(good) - 1):
        (tmp_path / "cut.png").write_bytes(good[:length])
        assert "cut.png" in refused("info", tmp_path / "cut.png")
    bent = bytearray(good)
    bent[len(bent) // 2] ^= 4
    (tmp_path / "bent.png").write_bytes(bent)
    assert "checksum" in refused("info", tmp_path / "bent.png")
    assert "does not exist" in refused("info", tmp_path / "none.tif")
    assert "is a folder" in refused("info", tmp_path)
    (tmp_path / "text.tif").write_text("no picture")
    assert "not a picture of a known type" in refused("info", tmp_path / "text.tif")
    assert "3 channels" in refused("info", save(tmp_path / "rgb.npy", np.zeros((9, 9, 3))))
    assert "--black: 900 DN is not below --white 800 DN" in misused("info", file, "--black", 900, "--white", 800)
    assert "need" in refused("info", file, "--raw-format", "mono8", "--size", "9x9")
    assert "size" in misused("info", file, "--raw-format", "mono8")


@pytest.mark.skipif(os.geteuid() == 0, reason="root reads everything")
def test_unreadable_files(refused, tmp_path):
    file = tmp_path / "a.png"
    file.write_bytes(png(4, 4))
    file.chmod(0)
    assert "cannot be opened" in refused("info", file)


def test_flags_may_stand_before_the_files(malus, tmp_path):
    file = save(tmp_path / "a.npy", noisy_polar_mosaic())
    found = malus("info", "--json", "--layout", "polar-mono", "--black", "60,61.5,62,63", file).json
    assert found["black"] == [60, 61.5, 62, 63]
    assert malus("info", "--json", "--black", 64, file, file).json["frames"][1]["black"] == [64]


def test_usage(malus):
    malus("info", code=2)
    malus("info", "x.png", "--frobnicate", code=2)
    assert "--raw-format" in malus("info", "--help").out


def test_emva_description(malus, refused, misused, tmp_path):
    (tmp_path / "d.txt").write_text("v 3.0\nn 16 4 4\nb 1000 5\ni i\\b.png\ni i\\gone.png\nd 1000\ni i\\d.png\n")
    (tmp_path / "i").mkdir()
    for name in "bd":
        (tmp_path / "i" / f"{name}.png").write_bytes(png(4, 4, 9))
    out = tmp_path / "s.toml"
    found = malus("session-from-emva", tmp_path / "d.txt", "-o", out, "--json").json
    assert found == {"session": str(out), "groups": 2, "frames": 2, "missing_images": 1}
    done = malus("session-from-emva", tmp_path / "d.txt", "-o", out, "--force", "--quiet")
    assert done.out == f"{out}: 2 sets, 2 frames\n"
    assert done.err == f"warning: {tmp_path}/d.txt: 1 of the 3 images that it names is absent and left out: i/gone.png (line 5)\n"
    assert 'paths = [\n  "i/b.png",\n]' in out.read_text()
    assert "--force" in refused("session-from-emva", tmp_path / "d.txt", "-o", out)
    assert "does not exist" in refused("session-from-emva", tmp_path / "d.txt", "-o", tmp_path / "no" / "s.toml")
    for read in ("d.txt", "i/b.png", "i/d.png"):
        before = (tmp_path / read).read_bytes()
        line = refused("session-from-emva", tmp_path / "d.txt", "-o", tmp_path / read, "--force")
        assert f"{read}: is an input and would be replaced" in line and (tmp_path / read).read_bytes() == before
    line = misused("session-from-emva", tmp_path / "d.txt", "-o", tmp_path / "t.toml", "--gain", 200)
    assert "--gain: is 200 dB, beyond any camera's" in line
    assert sorted(p.name for p in tmp_path.iterdir()) == ["d.txt", "i", "s.toml"]
    assert json.loads(malus("info", "--json", tmp_path / "i" / "b.png", "--session", out).out)["white"] == 65535


def test_an_emva_description_without_its_dark_images_gives_no_session(refused, tmp_path):
    (tmp_path / "d.txt").write_text("v 3.0\nn 16 4 4\nb 1000 5\ni b.png\nd 1000\ni gone.png\n")
    (tmp_path / "b.png").write_bytes(png(4, 4, 9))
    line = refused("session-from-emva", tmp_path / "d.txt", "-o", tmp_path / "s.toml")
    assert "d.txt: the images of its dark sets are all absent; copy them" in line
    assert not (tmp_path / "s.toml").exists()


def test_real_polarization_frames(malus, shared):
    for name in ("camera", "carps", "fruits", "polarizer"):
        found = malus("info", "--json", shared / "polar-mono-raw" / f"{name}.png", "--layout", "polar-mono").json
        assert found["layout_check"]["winner"] == "diagonal" and found["layout_check"]["margin"] > 1.3
    for name in ("01", "03", "05"):
        found = malus("info", "--json", shared / "polar-colour-raw" / f"{name}.png",
                      "--layout", "polar-bayer-rggb").json
        assert found["layout_check"]["winner"] == "diagonal" and len(found["channels"]) == 16
