#!/usr/bin/env python3
"""Writes fuzz/corpus/torch_archive and fuzz/corpus/pickle: archives of torch.save, and archives and pickles made to do harm.

The seeds are in the repository; this script says what each of them is.   fuzz/make_torch_seeds.py   (needs PyTorch)
"""

import collections
import io
import pathlib
import struct
import zipfile

import torch

CORPUS = pathlib.Path(__file__).parent / "corpus"


def saved(content):
    file = io.BytesIO()
    torch.save(content, file)
    return file.getvalue()


def entries_of(archive):
    with zipfile.ZipFile(io.BytesIO(archive)) as source:
        return [(i.filename.split("/", 1)[1], source.read(i)) for i in source.infolist()]


def archive_of(entries, method=zipfile.ZIP_STORED):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", method) as target:
        for name, data in entries:
            target.writestr(zipfile.ZipInfo("archive/" + name), data, method)
    return file.getvalue()


def with_pickle(pickle, values=bytes(16)):
    return archive_of([("data.pkl", pickle), ("data/0", values), ("version", b"3\n")])


def text(words):
    return b"X" + struct.pack("<I", len(words)) + words


def number(value):
    return b"\x8a\x08" + struct.pack("<q", value)


def state(shape, stride, offset=0, key=b"0"):
    """A pickled table of one float32 weight."""
    storage = b"(" + text(b"storage") + b"ctorch\nFloatStorage\n" + text(key) + text(b"cpu") + number(4) + b"tQ"
    sizes = [b"(" + b"".join(number(v) for v in values) + b"t" for values in (shape, stride)]
    return (b"\x80\x02}" + text(b"w") + b"ctorch._utils\n_rebuild_tensor_v2\n(" + storage + number(offset) + sizes[0] + sizes[1]
            + b"\x89ccollections\nOrderedDict\n)RtRs.")


def archives():
    weights = {"a.weight": torch.arange(12.0).reshape(3, 4), "b": torch.arange(4), "turned": torch.arange(6.0).reshape(2, 3).T,
               "half": torch.tensor([0.5, -2.0]).half(), "bf": torch.tensor([1.5]).bfloat16(), "none": torch.empty(0, 3),
               "one": torch.tensor(7.0), "part": torch.arange(10.0)[3:6], "tied": None}
    weights["tied"] = weights["a.weight"]
    good = saved(weights)
    yield "good_state", good
    yield "good_parallel", saved({"state_dict": collections.OrderedDict((f"module.{k}", v) for k, v in weights.items()), "epoch": 3})
    yield "good_checkpoint", saved({"epoch": 3, "loss": torch.tensor(0.5), "model_state_dict": {"w": torch.ones(2, 2)}})
    yield "good_parameters", saved({"params": {"w": torch.nn.Parameter(torch.ones(2, 2))}})
    yield "good_small_zip", with_pickle(state([2, 2], [2, 1]))  # without ZIP64
    yield "bad_hollow", with_pickle(state([0, 1 << 62], [1, 1]))
    yield "bad_empty", b""
    yield "bad_truncated", good[: len(good) // 2]
    yield "bad_cut_end", good[:-1]
    yield "bad_no_weights", saved({"a": 1})
    yield "bad_bomb", archive_of([("data.pkl", bytes(1 << 24))], zipfile.ZIP_DEFLATED)  # 16 MiB in 16 KiB
    yield "bad_packed", archive_of(entries_of(good), zipfile.ZIP_DEFLATED)
    yield "bad_twice", archive_of([("data.pkl", state([4], [1]))] * 2)
    yield "bad_other_zip", archive_of([("readme", b"nothing")])
    yield "bad_no_values", archive_of([("data.pkl", state([4], [1]))])
    yield "bad_beyond", with_pickle(state([5], [1]))
    yield "bad_offset", with_pickle(state([2], [1], offset=3))
    yield "bad_negative_offset", with_pickle(state([2], [1], offset=-1))
    yield "bad_stride", with_pickle(state([2], [1 << 62]))
    yield "bad_negative_stride", with_pickle(state([2], [-1]))
    yield "bad_huge_shape", with_pickle(state([1 << 31, 1 << 31, 1 << 31], [1, 1, 1]))
    yield "bad_expanded", with_pickle(state([4, 4, 4, 4], [0, 0, 0, 0]))
    yield "bad_dimensions", with_pickle(state([1] * 9, [1] * 9))
    yield "bad_ranks", with_pickle(state([1, 1], [1]))
    yield "bad_big_endian", archive_of([("byteorder", b"big")] + entries_of(saved({"w": torch.ones(2)})))
    tensor = state([1024], [1])[len(b"\x80\x02}" + text(b"w")):-len(b"s.")]
    many = b"\x80\x02}(" + text(b"w") + tensor + b"q\x01" + b"".join(text(b"%d" % i) + b"h\x01" for i in range(200)) + b"u."
    yield "bad_repeated_values", with_pickle(many, bytes(4096))
    end64 = good.rfind(b"PK\x06\x06")
    for name, at, value in (("count", 32, 1 << 60), ("size", 40, 1 << 63), ("place", 48, (1 << 64) - 8)):
        yield f"bad_zip64_{name}", good[: end64 + at] + struct.pack("<Q", value) + good[end64 + at + 8:]
    local = good.find(b"PK\x01\x02") + 42
    yield "bad_local_place", good[:local] + struct.pack("<I", 1 << 31) + good[local + 4:]


def pickles():
    yield "good_state", state([2, 2], [2, 1])
    yield "good_circle", b"\x80\x02]q\x00h\x00a."  # a list that holds itself
    yield "good_deep", b"\x80\x02)" + b"\x85" * 2000 + b"."  # a tuple in a tuple in a tuple
    yield "good_long_number", b"\x80\x02\x8a\xff" + bytes(255) + b"."
    yield "bad_empty", b""
    yield "bad_no_end", b"\x80\x02)"
    yield "bad_nothing_left", b"\x80\x02."
    yield "bad_marks", b"\x80\x02" + b"(" * 1000 + b"t" * 1001 + b"."
    yield "bad_mark_above", b"\x80\x02NN(at."
    yield "bad_text_length", b"\x80\x02X\xff\xff\xff\xff."
    yield "bad_memo", b"\x80\x02h\x07."
    yield "bad_odd_table", b"\x80\x02}(Nu."
    yield "bad_code", b"\x80\x02P0\n."
    yield "bad_name", b"\x80\x04" + text(b"x" * 300) + b"\x94" + (b"h\x00h\x00\x93" * 100) + b"."
    pairs = b"]q\x00(" + b"NN\x86" * 100 + b"e"
    yield "bad_tables", b"\x80\x02" + pairs + b"ccollections\nOrderedDict\nq\x01" + b"h\x01h\x00\x85R" * 100 + b"."


for folder, seeds, ending in (("torch_archive", archives(), "pth"), ("pickle", pickles(), "pkl")):
    (CORPUS / folder).mkdir(exist_ok=True)
    for seed, content in seeds:
        (CORPUS / folder / f"{seed}.{ending}").write_bytes(content)
