"""TIFF files that were cut off: what they tell lies at their end, and none is read as one that never told it."""

import struct

import numpy as np
import pytest

TAGS = "[malus layout=polar-mono black=82 white=4095 gain_db=12]"


@pytest.fixture
def own(malus, tmp_path):
    """A frame that the program wrote, as bytes."""
    np.save(tmp_path / "clean.npy", np.full((64, 64), 400, np.float32))
    malus("synthesize", tmp_path / "clean.npy", "--layout", "polar-mono", "--model", "imx250mzr-simulated", "--gain", "12", "-o", tmp_path)
    return (tmp_path / "clean_000.tif").read_bytes()


def tiff(order, big, exposure_s=None, description=TAGS, unknown=False):
    """16 x 16 values of 8 bits, behind them the directories, and last what these point to; returns the bytes, and where the description must be whole."""
    place = "Q" if big else "I"
    head = struct.calcsize("=" + place)
    pack = lambda form, *values: struct.pack((">" if order == "MM" else "<") + form, *values)
    start = order.encode() + (pack("HHHQ", 43, 8, 0, 16 + 256) if big else pack("HI", 42, 8 + 256)) + bytes(range(256))
    one = lambda tag, kind, value: (tag, kind, 1, pack({3: "H", 4: "I"}[kind], value))
    text = description.encode() + b"\0"
    main = [one(256, 3, 16), one(257, 3, 16), one(258, 3, 8), one(259, 3, 1), one(262, 3, 1), (270, 2, len(text), text),
            one(273, 4, len(start) - 256), one(277, 3, 1), one(278, 3, 16), one(279, 4, 256)]
    size = lambda n: (8 if big else 2) + n * (4 + 2 * head) + head
    exif_at = len(start) + size(len(main) + (exposure_s is not None) + unknown)
    exif = []
    if exposure_s is not None:
        main.append(one(34665, 4, exif_at))
        exif = [(33434, 5, 1, pack("II", round(1e6 * exposure_s), 10**6))]
    if unknown:  # of a type that no standard has, and so of unknown length
        main.append((65000, 99, 10**6, pack(place, 10**6)))
    extra_at = exif_at + (size(1) if exif else 0)
    directories, extra = b"", b""
    for entries in filter(None, (main, exif)):
        directories += pack("Q" if big else "H", len(entries))
        for tag, kind, count, value in entries:
            directories += pack("HH" + place, tag, kind, count)
            if len(value) > head:
                directories += pack(place, extra_at + len(extra))
                extra += value
            else:
                directories += value.ljust(head, b"\0")
        directories += pack(place, 0)
    return start + directories + extra, range(exif_at, extra_at + len(text))


@pytest.mark.parametrize("missing", [1, 2, 7, 30, 60])
def test_what_the_program_wrote_is_read_whole_or_not_at_all(malus, refused, own, tmp_path, missing):
    assert malus("info", tmp_path / "clean_000.tif", "--json").json["layout_known"]
    (tmp_path / "cut.tif").write_bytes(own[:-missing])
    for command in (["info"], ["denoise", "-o", tmp_path / "out"]):
        line = refused(*command, tmp_path / "cut.tif")
        assert "cut.tif: the TIFF file ends before its description; it is damaged or an incomplete copy: copy" in line
    assert not list(tmp_path.glob("out/*"))


@pytest.mark.parametrize("order", ["II", "MM"])
@pytest.mark.parametrize("big", [False, True])
def test_every_kind_of_directory_is_looked_through(malus, refused, tmp_path, order, big):
    path = tmp_path / "f.tif"
    whole, described = tiff(order, big, exposure_s=0.25, unknown=True)
    path.write_bytes(whole)
    found = malus("info", path, "--json").json
    assert found["layout"] == "polar-mono" and found["exposure_s"] == 0.25 and found["black"] == [82] * 4
    for length in {*range(290, described.start, 40), described.start - 1, *described[::40], described.stop - 1, len(whole) - 1}:
        path.write_bytes(whole[:length])
        line = refused("info", path)
        assert "ends before its" in line and ("description" in line) == (length in described), length


def test_bytes_behind_the_directory_are_no_fault(malus, own, tmp_path):
    (tmp_path / "longer.tif").write_bytes(own + b"more")
    assert malus("info", tmp_path / "longer.tif", "--json").json["layout"] == "polar-mono"


def test_directories_that_lead_nowhere_are_refused(refused, tmp_path):
    whole, _ = tiff("II", False)
    for at, value in ((4, 2**32 - 1), (4, len(whole) - 1), (266 + 5 * 12 + 4, 2**32 - 1), (266 + 5 * 12 + 8, 2**32 - 4)):
        (tmp_path / "f.tif").write_bytes(whole[:at] + struct.pack("<I", value) + whole[at + 4:])
        assert "ends before its" in refused("info", tmp_path / "f.tif")
