"""Arrays and tensors of every kind in and out: no copies where none are needed."""

import copy
import ctypes
import pickle

import numpy as np
import pytest
from PIL import Image

malus = pytest.importorskip("malus", reason="the Python module is not built (pybind11 is missing)")


@pytest.fixture(scope="module")
def model():
    return malus.Model("imx250myr-simulated")


@pytest.fixture(scope="module")
def torch():
    return pytest.importorskip("torch", reason="needs PyTorch")


class Tensor:
    """Something that knows nothing but DLPack."""

    def __init__(self, array):
        self.array = array
        self.asked = 0

    def __dlpack__(self):
        self.asked += 1
        return self.array.__dlpack__()

    def __dlpack_device__(self):
        return self.array.__dlpack_device__()


def test_writes_into_a_tensor_and_returns_it(model):
    clean, out = np.full((32, 64), 50, np.float32), Tensor(np.zeros((32, 64), np.float32))
    result = model.synthesize(clean, gain=12, seed=1, out=out)
    assert result is out and out.asked == 1
    assert np.array_equal(out.array, model.synthesize(clean, gain=12, seed=1))


def test_reads_a_transposed_tensor(model):
    clean = np.arange(64 * 32, dtype=np.float32).reshape(64, 32)
    assert np.array_equal(model.synthesize(Tensor(clean.T), gain=12, seed=1),
                          model.synthesize(np.ascontiguousarray(clean.T), gain=12, seed=1))


def test_a_tensor_of_a_device_is_refused(model):
    class OnGpu(Tensor):
        def __dlpack_device__(self):
            return 2, 0

    with pytest.raises(malus.InputError, match="memory of a device"):
        model.synthesize(OnGpu(np.zeros((8, 8), np.float32)), gain=12)


def test_torch_tensors_are_written_in_place(model, torch):
    clean = torch.full((32, 64), 50.0)
    out = torch.empty(32, 64)
    assert model.synthesize(clean, gain=12, seed=1, out=out) is out
    assert np.array_equal(out.numpy(), model.synthesize(clean.numpy(), gain=12, seed=1))
    assert torch.equal(clean, torch.full((32, 64), 50.0))
    model.synthesize(clean, gain=12, seed=1, out=clean)
    assert torch.equal(clean, out)


def test_torch_tensors_are_read_whatever_their_type(model, torch):
    clean = torch.arange(32 * 64, dtype=torch.int32).reshape(32, 64)
    expected = model.synthesize(clean.numpy().astype(np.float32), gain=12, seed=1)
    for kind in (torch.int32, torch.int64, torch.float64, torch.float32):
        assert np.array_equal(model.synthesize(clean.to(kind), gain=12, seed=1, black=0), expected)
    with pytest.raises(TypeError, match="float32"):
        model.synthesize(clean.to(torch.bfloat16), gain=12)


class Booleans(Tensor):
    """As newer tensors export them: DLPack's type 6, which lies behind the pointer, the device and the dimensions."""

    def __dlpack__(self):
        capsule = self.array.view(np.uint8).__dlpack__()
        pointer = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, ctypes.c_char_p)(("PyCapsule_GetPointer", ctypes.pythonapi))
        ctypes.memset(pointer(capsule, b"dltensor") + 20, 6, 1)
        return capsule

    def __dlpack_device__(self):
        return self.array.view(np.uint8).__dlpack_device__()


class Refusing(Tensor):
    """As older ones do not, but become arrays."""

    def __dlpack__(self):
        raise RuntimeError("Bool type is not supported by dlpack")

    def __array__(self, *_, **__):
        return self.array


@pytest.mark.parametrize("wrap", [Booleans, Refusing])
def test_masks_of_booleans_are_read(wrap):
    light = np.random.default_rng(1).uniform(100, 900, (16, 16)).astype(np.float32)
    mask = np.random.default_rng(2).uniform(size=(8, 8)) < 0.5
    expected = malus.normals(light, "polar-mono", mask=mask)
    assert np.isnan(expected[0][~mask]).all() and not np.isnan(expected[0]).all()
    assert np.array_equal(malus.normals(light, "polar-mono", mask=wrap(mask)), expected, equal_nan=True)


def test_masks_of_torch_are_read(torch):
    light = np.random.default_rng(1).uniform(100, 900, (16, 16)).astype(np.float32)
    mask = np.random.default_rng(2).uniform(size=(8, 8)) < 0.5
    made = malus.normals(light, "polar-mono", mask=torch.from_numpy(mask))
    assert np.array_equal(made, malus.normals(light, "polar-mono", mask=mask), equal_nan=True)


def test_what_a_tensor_that_is_no_array_raises_arrives(model):
    class Lost(Tensor):
        def __dlpack__(self):
            raise RuntimeError("the memory is gone")

    with pytest.raises(RuntimeError, match="^the memory is gone$"):
        model.synthesize(Lost(np.zeros((8, 8), np.float32)), gain=12)


def test_memory_of_tensors_is_given_back(model, torch):
    """Two thousand borrowed tensors of 4 MB: a leak would hold them all."""
    import resource
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for i in range(2000):
        clean = torch.zeros(1024, 1024)
        model.at_gain(12).synthesize(clean[:4, :4], seed=i)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000  # kB, of 8 GB


def test_a_batch_is_its_frames(model):
    clean = np.random.default_rng(0).uniform(0, 500, (3, 16, 8, 12)).astype(np.float32)
    batch = model.synthesize(clean, gain=24, seed=5, frame=10)
    for i in range(3):
        assert np.array_equal(batch[i], model.synthesize(clean[i], gain=24, seed=5, frame=10 + i))
    drawn = [model.random_gain(5, 10 + i) for i in range(3)]
    random = model.synthesize(clean, gain=None, seed=5, frame=10)
    for i in range(3):
        assert np.array_equal(random[i], model.synthesize(clean[i], gain=drawn[i], seed=5, frame=10 + i))


def test_a_crop_gets_the_noise_of_its_place(model):
    clean = np.random.default_rng(0).uniform(0, 500, (64, 96)).astype(np.float32)
    whole = model.synthesize(clean, gain=12, seed=3)
    crop = model.synthesize(clean[8:40, 12:60], gain=12, seed=3, row0=8, col0=12)
    assert np.array_equal(crop, whole[8:40, 12:60])


def test_the_sampler_that_is_kept_never_answers_for_other_settings(model):
    clean = np.full((32, 32), 100, np.float32)
    first = model.synthesize(clean, gain=12, seed=1)
    assert not np.array_equal(first, model.synthesize(clean, gain=12, seed=1, read=False))
    assert not np.array_equal(first, model.synthesize(clean, gain=13, seed=1))
    assert np.array_equal(first, model.synthesize(clean, gain=12, seed=1))
    assert np.array_equal(first, model.at_gain(12).synthesize(clean, seed=1))


def test_an_object_whose_value_changes_is_read_anew(model):
    class Ratio:
        def __init__(self, value):
            self.value = value

        def __float__(self):
            return self.value

        def __repr__(self):
            return "a ratio"

    clean = np.full((32, 32), 100, np.float32)
    draw = lambda ratio: model.synthesize(clean, gain=12, seed=1, ratio=ratio)
    expected = [draw(2), draw(4)]
    changing = Ratio(2.0)
    assert np.array_equal(draw(changing), expected[0])
    changing.value = 4.0
    assert np.array_equal(draw(changing), expected[1])


def test_tensors_that_print_alike_are_told_apart(model, torch):
    clean = np.full((32, 32), 100, np.float32)
    draw = lambda ratio: model.synthesize(clean, gain=12, seed=1, ratio=ratio)
    a, b = torch.tensor(5e-5, dtype=torch.float64), torch.tensor(5.00001e-5, dtype=torch.float64)
    assert repr(a) == repr(b)
    first = draw(a)
    assert not np.array_equal(first, draw(b))
    assert np.array_equal(draw(b), draw(5.00001e-5)) and np.array_equal(draw(a), first)


def packed_field(rows=8, cols=8):
    """float32 numbers at 1 + 33 i + 4 k bytes."""
    return np.zeros(rows, dtype=[("flag", "u1"), ("x", np.float32, (cols,))])


def test_a_packed_field_is_no_output_and_stays_untouched(model):
    table = packed_field()
    with pytest.raises(TypeError, match="out must hold its numbers at multiples of 4 bytes"):
        model.synthesize(np.full((8, 8), 50, np.float32), gain=12, out=table["x"])
    assert not any(table.tobytes())
    planes = np.zeros((16, 2), dtype=[("flag", "u1"), ("x", np.float32, (4,))])
    with pytest.raises(TypeError, match="out must hold its numbers at multiples of 4 bytes"):
        model.synthesize(np.full((16, 2, 4), 50, np.float32), gain=12, out=planes["x"])
    assert not any(planes.tobytes())


def test_an_aligned_field_is_written_in_place(model):
    clean = np.full((8, 8), 50, np.float32)
    table = np.zeros(8, dtype=[("flag", "u4"), ("x", np.float32, (8,))])
    model.synthesize(clean, gain=12, seed=1, out=table["x"])
    assert np.array_equal(table["x"], model.synthesize(clean, gain=12, seed=1)) and not table["flag"].any()


def test_unaligned_numbers_are_read(model):
    clean = np.random.default_rng(0).uniform(0, 500, (8, 8)).astype(np.float32)
    expected = model.synthesize(clean, gain=12, seed=1)
    table = packed_field()
    table["x"] = clean
    assert np.array_equal(model.synthesize(table["x"], gain=12, seed=1), expected)
    shifted = np.zeros(clean.nbytes + 1, np.uint8)[1:].view(np.float32).reshape(8, 8)
    shifted[:] = clean
    assert not shifted.flags.aligned
    assert np.array_equal(model.synthesize(shifted, gain=12, seed=1), expected)
    with pytest.raises(TypeError, match="multiples of 4 bytes"):
        model.synthesize(clean, gain=12, out=shifted)
    assert np.array_equal(shifted, clean)


def test_an_unpickled_array_is_written_in_place(model):
    """Its type is float32, but not the same object as other arrays'."""
    clean = np.full((8, 8), 50, np.float32)
    out = pickle.loads(pickle.dumps(np.empty_like(clean)))
    assert model.synthesize(clean, gain=12, seed=1, out=out) is out
    assert np.array_equal(out, model.synthesize(clean, gain=12, seed=1))


def test_the_other_byte_order_is_read_and_not_written(model):
    clean = np.full((8, 8), 50, np.float32)
    swapped = clean.astype(clean.dtype.newbyteorder())
    assert np.array_equal(model.synthesize(swapped, gain=12, seed=1), model.synthesize(clean, gain=12, seed=1))
    with pytest.raises(TypeError, match="float32"):
        model.synthesize(clean, gain=12, out=swapped)


@pytest.mark.parametrize("given", ["abc", [[1, None]], [["1", "2"]], [[1j]], None])
def test_what_holds_no_numbers_is_refused_by_name(model, given):
    layout = model.layout
    numbers = np.zeros((8, 8), np.float32)
    for name, call in (("clean", lambda: model.synthesize(given, gain=12)),
                       ("raw", lambda: malus.denoise(given, layout=layout, white=100)),
                       ("dn_above_black", lambda: malus.stokes(given, layout)),
                       ("test", lambda: malus.evaluate(numbers, given, layout, 100)),
                       ("reference", lambda: malus.compare_noise(given, numbers, layout)),
                       ("a", lambda: malus.jsd_bits(given, [1, 2]))):
        wanted = "is 'abc', a path or a name" if given == "abc" else "must be an array of numbers"
        with pytest.raises(TypeError, match=f"^{name} {wanted}"):
            call()


def test_a_frame_in_place_of_numbers_is_called_one():
    frame = malus.Frame(np.zeros((8, 8), np.uint16), "mono", white=100)
    numbers = np.zeros((8, 8), np.float32)
    for name, call in (("reference", lambda: malus.evaluate(frame, numbers, "mono", 100)),
                       ("test", lambda: malus.evaluate(numbers, frame, "mono", 100))):
        with pytest.raises(TypeError, match=f"^{name} must be an array of numbers, not a Frame; give its .dn, less black"):
            call()


@pytest.mark.parametrize("name", ["row0", "col0"])
@pytest.mark.parametrize("place", [-1, 2**30 - 63, 2**31 - 1, 2**31])
def test_places_off_the_sensor_are_refused(model, name, place):
    clean = np.zeros((64, 64), np.float32)
    with pytest.raises(malus.InputError, match=f"^{name}: {place} .* give 0 to {2**30 - 64}$"):
        model.synthesize(clean, gain=12, **{name: place})
    with pytest.raises(malus.InputError, match=f"^{name}: "):
        model.at_gain(12).synthesize(clean, **{name: place})
    model.synthesize(clean, gain=12, **{name: 2**30 - 64})


@pytest.mark.parametrize("out", [
    np.zeros((8, 8)),                                      # float64
    np.zeros((8, 16), np.float32)[:, ::2],                 # gaps within rows
    np.zeros((8, 9), np.float32),                          # another shape
    np.broadcast_to(np.zeros(8, np.float32), (8, 8)),      # read-only
])
def test_outputs_that_cannot_be_written_in_place_are_refused(model, out):
    with pytest.raises((TypeError, ValueError), match="out"):
        model.synthesize(np.zeros((8, 8), np.float32), gain=12, out=out)


def test_frames_share_their_memory(tmp_path):
    np.save(tmp_path / "frame.npy", np.arange(64, dtype=np.uint16).reshape(8, 8))
    frame = malus.load_frame(tmp_path / "frame.npy", layout="mono", black=2, white=63)
    assert np.shares_memory(frame.dn, frame.dn)
    pixels = frame.dn
    del frame
    assert np.array_equal(pixels, np.arange(64).reshape(8, 8))


def test_a_session_knows_its_frames(tmp_path):
    np.save(tmp_path / "a.npy", np.full((8, 8), 70, np.uint16))
    (tmp_path / "session.toml").write_text(
        '[sensor]\nname = "s"\nlayout = "bayer-rggb"\nblack = 64\nwhite = 1023\n'
        '[[frames]]\nkind = "bias"\ngain_db = 6\nexposure_s = 0.01\npaths = ["*.npy"]\n')
    session = malus.Session(tmp_path / "session.toml")
    group = session.groups[0]
    assert (session.sensor, session.layout, group.kind, group.gain_db, group.iso) == ("s", "bayer-rggb", "bias", 6, None)
    frame = session.load(0, 0)
    assert frame.black_dn == [64] * 4 and frame.gain_db == 6 and frame.exposure_s == 0.01 and frame.dn[0, 0] == 70
    with pytest.raises(IndexError):
        session.load(0, 1)
    by_group = session.load(group, 0)
    assert by_group.black_dn == frame.black_dn and by_group.gain_db == 6 and np.array_equal(by_group.dn, frame.dn)
    assert np.array_equal(session.load(group=group, index=0).dn, frame.dn)
    with pytest.raises(IndexError):
        session.load(group, 1)
    (tmp_path / "other").mkdir()
    (tmp_path / "other/session.toml").write_text((tmp_path / "session.toml").read_text())
    np.save(tmp_path / "other/a.npy", np.full((8, 8), 70, np.uint16))
    with pytest.raises(malus.InputError, match="^group: is none of this session's"):
        malus.Session(tmp_path / "other/session.toml").load(group, 0)


def test_a_cell_of_a_session_s_own_is_pickled(tmp_path):
    """It has no name: polar-mono turned by half a turn."""
    np.save(tmp_path / "a.npy", np.arange(64, dtype=np.uint16).reshape(8, 8))
    (tmp_path / "session.toml").write_text('[sensor]\nblack = [1, 2, 3, 4]\nwhite = 4095\n[sensor.cell]\nrows = [["0", "135"], ["45", "90"]]\n'
                                           '[[frames]]\nkind = "bias"\npaths = ["*.npy"]\n')
    frame = malus.Session(tmp_path / "session.toml").load(0, 0)
    assert frame.channels == ["0", "135", "45", "90"] and frame.layout == "custom"
    for again in (pickle.loads(pickle.dumps(frame)), copy.deepcopy(frame)):
        assert again.channels == frame.channels and repr(again) == repr(frame) and (again.dn == frame.dn).all()
        assert np.array_equal(malus.stokes(again)["aolp_deg"], malus.stokes(frame)["aolp_deg"], equal_nan=True)


def test_a_session_is_not_believed_against_its_files(tmp_path):
    """As calibrate and pairs take it: files may tell what the session does not, and never something else."""
    for name, exposure in (("a", 0.01), ("b", 0.04)):
        pixels = Image.fromarray(np.full((8, 8), 70, np.uint16))
        pixels.save(tmp_path / f"{name}.tif", description=f"[malus exposure_s={exposure}]")
    text = '[sensor]\nlayout = "mono"\n[[frames]]\nkind = "bias"\n{}paths = ["{}.tif"]\n'
    (tmp_path / "s.toml").write_text(text.format("exposure_s = 0.02\n", "a"))
    with pytest.raises(malus.InputError, match="a.tif: was taken at 0.01 s, the session says 0.02 s"):
        malus.Session(tmp_path / "s.toml").load(0, 0)
    (tmp_path / "s.toml").write_text(text.format("", "*"))
    session = malus.Session(tmp_path / "s.toml")
    assert session.load(0, 0).exposure_s == 0.01
    with pytest.raises(malus.InputError, match="b.tif: was taken at 0.04 s, but .*a.tif of the same set at 0.01 s"):
        session.load(0, 1)


def test_frames_are_denoised_with_what_they_know(model, tmp_path):
    clean = np.full((128, 128), 300, np.float32)
    raw = np.clip(np.round(model.synthesize(clean, gain=24, seed=1) + 82), 0, 4095).astype(np.uint16)
    np.save(tmp_path / "raw.npy", raw)
    frame = malus.load_frame(tmp_path / "raw.npy", layout=model.layout, black=82, white=4095)
    by_frame = malus.denoise(frame, model=model, gain=24)["dn"]
    by_array = malus.denoise(raw, layout=model.layout, black=82, white=4095, model=model, gain=24)["dn"]
    assert np.array_equal(by_frame, by_array)
    with pytest.raises(malus.InputError, match="gain"):
        malus.denoise(frame, model=model)
    with pytest.raises(malus.InputError, match="layout"):
        malus.denoise(raw, black=82)


def test_comparison_of_noise(model):
    """Two draws of one model stay near the floor; another gain lies far above it."""
    dark = np.zeros((256, 256), np.float32)
    draw = lambda gain, first: np.stack([model.synthesize(dark, gain=gain, seed=1, frame=first + i) for i in range(4)])
    same = malus.compare_noise(draw(12, 0), draw(12, 4), model.layout)
    other = malus.compare_noise(draw(12, 0), draw(24, 4), model.layout)
    assert len(same["sd_test"]) == 16
    assert other["sqrt_jsd"] > 10 * same["sqrt_jsd"] and other["jsd"] == pytest.approx(other["sqrt_jsd"] ** 2)


def test_less_than_a_cell_is_refused(model):
    small = np.full((3, 64), 300, np.float32)
    with pytest.raises(malus.InputError, match="smaller than one cell of polar-bayer-rggb"):
        malus.stokes(small, model.layout)
    with pytest.raises(malus.InputError, match="smaller than one cell of polar-bayer-rggb"):
        malus.evaluate(small, small, model.layout, 4095)


def test_pixels_that_are_no_numbers_are_said(model):
    given = dict(layout=model.layout, black=0, white=4095, model=model, gain=12)
    with pytest.warns(UserWarning, match="4096 pixels are NaN, infinite, or beyond 100 times white"):
        assert np.isnan(malus.denoise(np.full((64, 64), np.nan, np.float32), **given)["dn"]).all()
    holed = np.full((64, 64), 300, np.float32)
    holed[3, 4] = np.nan
    with pytest.warns(UserWarning, match="1 pixel is NaN, infinite, or beyond 100 times white; it stays as it is"):
        assert np.isnan(malus.denoise(holed, **given)["dn"][3, 4])
