"""Arguments of a wrong type are refused with one line that names them, what they are and what is wanted."""

import os
import pathlib
import re

import numpy as np
import pytest

malus = pytest.importorskip("malus", reason="the Python module is not built (pybind11 is missing)")
MODEL = malus.Model("imx250myr-simulated")
CODES = np.full((64, 64), 300, np.uint16)
BATCH = np.zeros((8, 8), np.float32)


def test_the_name_of_a_networks_file_need_not_be_utf8():
    name = os.fsdecode(b"n\xe4me/net.safetensors")
    for method in (name, pathlib.PurePosixPath(name)):
        with pytest.raises(malus.InputError, match="safetensors: (?!.*give a text)"):
            malus.denoise(CODES, layout="mono", white=4095, method=method)


@pytest.mark.parametrize("call, line", [
    (lambda: malus.denoise(CODES, gain="high"), r"gain is 'high' (str); give a number, or None"),
    (lambda: malus.denoise(CODES, origin=(1, 2, 3)), r"origin is (1, 2, 3) (tuple); give 2 values, each a whole number, or None"),
    (lambda: malus.denoise(CODES, black=["a"]), r"black is ['a'] (list); give a number or a list, each a number, or None"),
    (lambda: malus.denoise(CODES, white=BATCH), "white is array([[0., 0., 0., 0., 0., 0., 0., 0.], [0., 0., 0., 0.,... (ndarray); give a number, or None"),
    (lambda: malus.denoise(), r"raw is missing; give denoise one"),
    (lambda: malus.denoise(CODES, "mono"), r"denoise takes 1 arguments by place, and 2 are given; name the others"),
    (lambda: malus.load_frame(3), r"path is 3 (int); give a path"),
    (lambda: malus.load_frame("x.tif", laout="mono"),
     r"unknown keyword argument laout of load_frame; did you mean layout? known: path, layout, black, white, raw_format, size, mean_of"),
    (lambda: malus.load_frame("x.tif", path="y.tif"), r"path is given twice to load_frame; leave one out"),
    (lambda: malus.Model(3), r"path is 3 (int); give a path"),
    (lambda: malus.Model(), r"path is missing; give Model a path"),
    (lambda: malus.Frame(CODES, 5), r"layout is 5 (int); give a text, or None"),
    (lambda: malus.set_threads(2.5), r"threads is 2.5 (float); give a whole number"),
    (lambda: MODEL.synthesize(BATCH, gain=None, seed=1.5), r"seed is 1.5 (float); give a whole number"),
    (lambda: MODEL.synthesize(BATCH, seed=2**64),
     r"seed is 18446744073709551616; give 0 to 2^64 - 1"),
    (lambda: MODEL.synthesize(BATCH, frame=-1), r"frame is -1; give 0 to 2^32 - 1"),
    (lambda: MODEL.random_gain(1), r"frame is missing; give random_gain a whole number"),
    (lambda: malus.denoise(CODES, origin=(2**40, 0)),
     r"origin is (1099511627776, 0); give 0 to 2^31 - 1"),
    (lambda: malus.load_frame("x.raw", size=(2**31, 4)),
     r"size is (2147483648, 4); give 0 to 2^31 - 1"),
    (lambda: malus.denoise(CODES, black=np.zeros((2, 2))), r"black is array([[0., 0.], [0., 0.]]) (ndarray); give a number or a list, each a number, or None"),
    (lambda: malus.denoise(CODES, black=np.array("a")), r"black is array('a', dtype='<U1') (ndarray); give a number or a list, each a number, or None"),
    (lambda: malus.denoise(CODES, gain=10**400), "gain is 1" + "0" * 56 + "... (int); give a number, or None"),
    (lambda: malus.denoise(CODES, variance=[1]), r"variance is [1] (list); give True or False"),
    (lambda: malus.simulate(BATCH, color_matrix=np.eye(3)),
     r"color_matrix is array([[1., 0., 0.], [0., 1., 0.], [0., 0., 1.]]) (ndarray); give a list, each a number"),
    (lambda: malus.simulate(BATCH, white_balance=np.array("a")), r"white_balance is array('a', dtype='<U1') (ndarray); give a list, each a number"),
    (lambda: malus.denoise(CODES, layout="mono", white=4095, strength="x"), r"strength is 'x' (str); give a number"),
    (lambda: malus.denoise(CODES, layout="mono", white=4095, row_noise="x"), r"row_noise is 'x' (str); give True or False"),
    (lambda: malus.denoise(CODES, layout="mono", white=4095, profile=3), r"profile is 3 (int); give a text"),
    (lambda: malus.denoise(CODES, layout="mono", white=4095, tile_batch=2**40),
     r"tile_batch is 1099511627776; give 0 to 2^31 - 1"),
    (lambda: malus.renoise(CODES, MODEL, 24, gain=12),
     r"unknown keyword argument gain of renoise; did you mean to_gain? known: raw, model, to_gain, from_gain, guide, rounded, seed, frame, layout, "
     "black, white, kind, method"),
    (lambda: MODEL.at_gain(12, amplifi=2),
     r"unknown keyword argument amplifi of at_gain; did you mean amplify? known: gain, kind, parameters, ratio, amplify, debias, shot, read, row, "
     "quantization, bias, exact, extrapolate_gain"),
    (lambda: malus.renoise(CODES, MODEL, "x" * 100), "to_gain is '" + "x" * 56 + "... (str); give a number"),
])
def test_one_line_names_the_argument(call, line):
    with pytest.raises(TypeError) as raised:
        call()
    assert "\n" not in str(raised.value) and "incompatible" not in str(raised.value)
    assert str(raised.value) == line
    assert raised.value.__cause__ is None and raised.value.__context__ is None


def test_errors_within_arguments_stay_as_they_are():
    """What an argument itself throws, and what its repr throws while the line is made."""
    class Strange:
        def __repr__(self):
            raise ValueError("no text")

        def __array__(self, *_, **__):
            raise TypeError("no array")

    with pytest.raises(TypeError, match="^no array$"):
        malus.denoise(Strange(), layout="mono", white=4095)
    with pytest.raises((TypeError, ValueError)) as raised:
        malus.load_frame(Strange())
    assert not isinstance(raised.value, malus.InputError)


def test_every_function_explains():
    """Those that pybind11 adds to classes as well: none shows the list of all types."""
    for name in malus.__all__:
        thing = getattr(malus, name)
        if callable(thing) and not (isinstance(thing, type) and issubclass(thing, Exception)) and name not in ("FrameGroup", "Noise"):
            with pytest.raises(TypeError) as raised:
                thing(**{"no such": 1}) if name in ("models", "layouts") else thing(*[object()] * 40)
            assert "\n" not in str(raised.value), (name, str(raised.value))
            assert re.search("takes|unknown", str(raised.value)), (name, str(raised.value))
