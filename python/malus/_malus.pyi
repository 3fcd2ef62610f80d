from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Protocol, SupportsFloat, TypeVar, overload

import numpy
from numpy.typing import ArrayLike, NDArray

__version__: str

Floats = NDArray[numpy.float32]

class DLPack(Protocol):
    """A tensor of any library, in the memory of the CPU."""

    def __dlpack__(self) -> Any: ...
    def __dlpack_device__(self) -> tuple[int, int]: ...

class Frames(Protocol):
    """Mosaics or Frames by number: an array [frame, row, column], a list, a data set in a file."""

    def __len__(self) -> int: ...
    def __getitem__(self, index: int, /) -> Any: ...

Arrays = ArrayLike | DLPack
Levels = SupportsFloat | Sequence[SupportsFloat] | NDArray[Any] | DLPack
Out = TypeVar("Out", Floats, DLPack)

class InputError(ValueError): ...

class Frame:
    def __init__(
        self,
        dn: Arrays,
        layout: str | None = None,
        black: Levels | None = None,
        white: SupportsFloat | None = None,
        *,
        gain_db: float | None = None,
        iso: float | None = None,
        exposure_s: float | None = None,
        mean_of: int = 1,
    ) -> None: ...
    @property
    def dn(self) -> Floats: ...
    @property
    def layout(self) -> str: ...
    @property
    def channels(self) -> list[str]: ...
    @property
    def black_dn(self) -> list[float]: ...
    @property
    def white_dn(self) -> float: ...
    @property
    def gain_db(self) -> float | None: ...
    @property
    def iso(self) -> float | None: ...
    @property
    def exposure_s(self) -> float | None: ...
    @property
    def mean_of(self) -> int: ...
    @property
    def source(self) -> str: ...

class FrameGroup:
    @property
    def kind(self) -> str: ...
    @property
    def gain_db(self) -> float | None: ...
    @property
    def iso(self) -> float | None: ...
    @property
    def exposure_s(self) -> float | None: ...
    @property
    def level(self) -> int | None: ...
    @property
    def paths(self) -> list[Path]: ...

class Session:
    def __init__(self, path: str | PathLike[str]) -> None: ...
    @property
    def sensor(self) -> str: ...
    @property
    def layout(self) -> str | None: ...
    @property
    def groups(self) -> list[FrameGroup]: ...
    def load(self, group: int | FrameGroup, index: int) -> Frame: ...

class FrameSet:
    def __init__(
        self,
        kind: str,
        frames: Frames,
        *,
        gain_db: float | None = None,
        iso: float | None = None,
        exposure_s: float | None = None,
        level: int | None = None,
    ) -> None: ...
    def __len__(self) -> int: ...

class Noise:
    @overload
    def synthesize(self, clean: Arrays, seed: int = 0, frame: int = 0, out: None = None, *, row0: int = 0, col0: int = 0, black: Levels | None = None, rounded: bool = False) -> Floats: ...
    @overload
    def synthesize(self, clean: Arrays, seed: int = 0, frame: int = 0, *, out: Out, row0: int = 0, col0: int = 0, black: Levels | None = None, rounded: bool = False) -> Out: ...

class Model:
    def __init__(self, path: str | PathLike[str]) -> None: ...
    def at_gain(
        self,
        gain: float | None,
        *,
        kind: str = "physics",
        parameters: str = "sampled",
        ratio: float = 1.0,
        amplify: bool = False,
        debias: bool = False,
        shot: bool = True,
        read: bool = True,
        row: bool = True,
        quantization: bool = True,
        bias: bool = True,
        exact: bool = False,
        extrapolate_gain: bool = False,
    ) -> Noise: ...
    @overload
    def synthesize(
        self,
        clean: Arrays,
        gain: float | None = None,
        seed: int = 0,
        frame: int = 0,
        out: None = None,
        *,
        row0: int = 0,
        col0: int = 0,
        black: Levels | None = None,
        rounded: bool = False,
        kind: str = "physics",
        parameters: str = "sampled",
        ratio: float = 1.0,
        amplify: bool = False,
        debias: bool = False,
        shot: bool = True,
        read: bool = True,
        row: bool = True,
        quantization: bool = True,
        bias: bool = True,
        exact: bool = False,
        extrapolate_gain: bool = False,
    ) -> Floats: ...
    @overload
    def synthesize(
        self,
        clean: Arrays,
        gain: float | None = None,
        seed: int = 0,
        frame: int = 0,
        *,
        out: Out,
        row0: int = 0,
        col0: int = 0,
        black: Levels | None = None,
        rounded: bool = False,
        kind: str = "physics",
        parameters: str = "sampled",
        ratio: float = 1.0,
        amplify: bool = False,
        debias: bool = False,
        shot: bool = True,
        read: bool = True,
        row: bool = True,
        quantization: bool = True,
        bias: bool = True,
        exact: bool = False,
        extrapolate_gain: bool = False,
    ) -> Out: ...
    def random_gain(self, seed: int, frame: int, *, kind: str = "physics") -> float: ...
    def save(self, path: str | PathLike[str], force: bool = False) -> None: ...
    def as_dict(self) -> dict[str, Any]: ...
    @property
    def sensor(self) -> str: ...
    @property
    def layout(self) -> str: ...
    @property
    def channels(self) -> list[str]: ...
    @property
    def kinds(self) -> list[str]: ...

def models() -> list[str]: ...
def pack(mosaic: Arrays, layout: str) -> Floats: ...
def unpack(planes: Arrays, layout: str) -> Floats: ...
def frames(path: str | PathLike[str]) -> list[Path]: ...
def info(
    raw: Frame | Arrays | str | PathLike[str],
    layout: str | None = None,
    black: Levels | None = None,
    white: SupportsFloat | None = None,
    *,
    raw_format: str | None = None,
    size: tuple[int, int] | None = None,
) -> dict[str, Any]: ...
def load_frame(
    path: str | PathLike[str],
    layout: str | None = None,
    black: Levels | None = None,
    white: SupportsFloat | None = None,
    *,
    raw_format: str | None = None,
    size: tuple[int, int] | None = None,
    mean_of: int | None = None,
) -> Frame: ...
def average(frames: list[Frame]) -> Frame: ...
def calibrate(
    session: Session | str | PathLike[str] | Sequence[FrameSet],
    kinds: str | Sequence[str] = ("physics",),
    *,
    sensor: str = "",
    layout: str | None = None,
    black: Levels | None = None,
    white: SupportsFloat | None = None,
    row_group: int | None = None,
    saturation_limit: float = 0.7,
    shape: str = "likelihood",
    single_frame: bool = False,
    maps: bool = True,
    level_step: float = 0.0,
    bins: int = 240,
    level_samples: int = 200000,
    dark_frames: int = 16,
) -> Model: ...
def denoise(
    raw: Frame | Arrays,
    *,
    layout: str | None = None,
    black: Levels | None = None,
    white: SupportsFloat | None = None,
    model: Model | str | PathLike[str] | None = None,
    gain: float | None = None,
    origin: tuple[int, int] | None = None,
    variance: bool = False,
    extrapolate_gain: bool = False,
    method: str | PathLike[str] = "nl-ridge",
    profile: str = "normal",
    memory: float = 1024.0,
    strength: float = 1.0,
    row_noise: bool = True,
    column_noise: bool = True,
    defects: bool = True,
    fixed_pattern: bool = True,
    like_pixels: bool = True,
    device: str = "cpu",
    precision: str = "float32",
    tile_batch: int = 1,
    ratio: float | None = None,
) -> dict[str, Any]: ...
def estimate_noise(
    raw: Frame | Arrays,
    *,
    layout: str | None = None,
    black: Levels | None = None,
    white: SupportsFloat | None = None,
) -> dict[str, Any]: ...
def stokes(
    dn_above_black: Frame | Arrays,
    layout: str | None = None,
    *,
    demosaick: str | None = None,
    variance: Arrays | None = None,
    denoised: bool = True,
    model: Model | str | PathLike[str] | None = None,
    gain: float | None = None,
    extrapolate_gain: bool = False,
    fixed_pattern: bool = True,
    black: Levels | None = None,
) -> dict[str, Floats]: ...
def normals(
    dn_above_black: Frame | Arrays,
    layout: str | None = None,
    *,
    mask: Arrays | None = None,
    demosaick: str | None = None,
    black: Levels | None = None,
    index: float = 1.5,
    model: str = "diffuse",
    azimuth: str = "convex",
    above_brewster: bool = False,
    foreground: float = 0.05,
) -> Floats: ...
def check_layout(dn_above_black: Arrays, *, black: Levels | None = None) -> dict[str, Any]: ...
def simulate(
    picture: Arrays | str | PathLike[str],
    layout: str = "polar-bayer-rggb",
    *,
    polarized: bool = False,
    truth: bool = False,
    tone: str = "auto",
    seed: int = 0,
    scene: int = 0,
    full_scale: float = 4000.0,
    exposure: float = 1.0,
    color_matrix: Sequence[float] = (),
    white_balance: Sequence[float] = (),
    index: float = 1.5,
    relief: float = 70.0,
    gloss: float = 0.4,
    bumps: int = 24,
) -> dict[str, Floats]: ...
def renoise(
    raw: Frame | Arrays,
    model: Model | str | PathLike[str],
    to_gain: float,
    *,
    from_gain: float | None = None,
    guide: Arrays | None = None,
    rounded: bool = False,
    seed: int = 0,
    frame: int = 0,
    layout: str | None = None,
    black: Levels | None = None,
    white: SupportsFloat | None = None,
    kind: str = "physics",
    method: str = "noise-on-noise",
) -> Floats: ...
def mosaic(s0: Arrays, s1: Arrays, s2: Arrays, layout: str) -> Floats: ...
def evaluate(reference: Arrays, test: Arrays, layout: str, peak: float) -> dict[str, float]: ...
def compare_noise(
    reference: Arrays,
    test: Arrays,
    layout: str,
    clean: Arrays | None = None,
    *,
    bins: int = 128,
    levels: int = 16,
    remove_fixed_pattern: bool = False,
) -> dict[str, Any]: ...
def kld_nats(test_q: Arrays, reference_p: Arrays) -> float: ...
def jsd_bits(a: Arrays, b: Arrays) -> float: ...
def layouts() -> list[str]: ...
def set_threads(threads: int) -> int: ...
