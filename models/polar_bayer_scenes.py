#!/usr/bin/env python3
"""The training scenes of models/polar-bayer.toml, from public four-angle pictures.

    apt-get install python3-opencv
    /usr/bin/python3 models/polar_bayer_scenes.py PUBLIC SCENES

PUBLIC holds checkouts of pjlapray/LMMSE-Demosaicing-for-Colour-Polarization-Filter-Array, pjlapray/LMMSE-Demosaicing-for-
Polarization-Filter-Array, pjlapray/Polarimetric_Spectral_Database, wsj890411/CPDNet, wsj890411/JCPD_Model and
RomanGDB/PolarizationDemosaickingPCDP, under these names without the owner. The first scene of both LMMSE repositories and
`cellphonecases` are left out: they are the scenes that the network is measured on. Writes SCENES/NAME/I0.png, I45.png, I90.png,
I135.png (16 bits), a scene several times under names of its own where it is to be drawn more often than a picture.
"""
import pathlib
import shutil
import sys

import cv2
import numpy as np

ANGLES = (0, 45, 90, 135)
COLOUR, MONO, NIR = "LMMSE-Demosaicing-for-Colour-Polarization-Filter-Array", "LMMSE-Demosaicing-for-Polarization-Filter-Array", "Polarimetric_Spectral_Database"
# Name: the files of its angles, how it is scaled (noise of one 8-bit exposure is averaged), white.
SCENES = {
    "kettle": ("PolarizationDemosaickingPCDP/docs/images/kettle/I{}.png", 1, 255),
    "tissue": ("PolarizationDemosaickingPCDP/docs/images/tejido_denso/I{}.png", 0.8, 255),
    "wen_2": (COLOUR + "/Data/Dataset/{}_2.png", 2 / 3, 255),
    "wen_3": (COLOUR + "/Data/Dataset/{}_3.png", 2 / 3, 255),
    "wen_61": ("CPDNet/OL_CPDNET_DATA/Test/test_dataset/61/gt_{}/61.png", 2 / 3, 255),
    "wen_15": ("JCPD_Model/test_dataset/15/gt_{}/15.png", 1, 255),
    "wen_31": ("JCPD_Model/test_dataset/31/gt_{}/31.png", 1, 255),
    "lapray_2": (MONO + "/Data/Dataset/{}_2.png", 1, 65535),
    "lapray_3": (MONO + "/Data/Dataset/{}_3.png", 1, 65535),
}
HYBRIDS = ("fabrics", "food", "glass", "knife", "leaves", "liquid", "macbeth_classic", "macbeth_enhancement", "painting", "potery")
COLOUR_COPIES, HYBRID_COPIES = 5, 2


def read(path, scale):
    picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if picture is None:
        sys.exit(f"{path}: cannot be read; check out its repository there")
    picture = picture[..., :3] if picture.ndim == 3 else picture
    return cv2.resize(picture.astype(np.float32), None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)


def colour_scene(public, files, scale, white):
    """S0, S1, S2 of the least squares: four angles have one more number than the light."""
    i0, i45, i90, i135 = (read(public / files.format(angle), scale) / white for angle in ANGLES)
    return (i0 + i45 + i90 + i135) / 2, i0 - i90, i45 - i135


def hybrid(public, name):
    """The polarization of the near infrared, of which raw pictures are kept, on the colours of the visible."""
    folder = public / NIR / name
    n0, n45, n90, n135 = (read(folder / f"Raw/NIR_filtre_nir_{angle}_aligned.tif", 0.5) for angle in ANGLES)
    light = (read(folder / "sRGB.tif", 0.5) / 255) ** 2.2 * (2 / 2.2)
    s0 = np.maximum((n0 + n45 + n90 + n135) / 2, 300)
    q, u = (n0 - n90) / s0, (n45 - n135) / s0
    most = np.maximum(np.hypot(q, u), 1)
    edge = np.s_[8:-8, 8:-8]  # alignment leaves the borders empty
    return tuple(x[edge] for x in (light, light * (q / most)[..., None], light * (u / most)[..., None]))


def write(folder, copies, s0, s1, s2):
    folder.mkdir(parents=True, exist_ok=True)
    for angle, picture in zip(ANGLES, (s0 + s1, s0 + s2, s0 - s1, s0 - s2)):
        cv2.imwrite(str(folder / f"I{angle}.png"), np.clip(np.round(picture / 2 * 65535), 0, 65535).astype(np.uint16))
    for copy in range(1, copies):
        shutil.copytree(folder, folder.with_name(f"{folder.name}_copy{copy}"), dirs_exist_ok=True)


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    public, scenes = map(pathlib.Path, sys.argv[1:])
    for name, parts in SCENES.items():
        write(scenes / name, COLOUR_COPIES, *colour_scene(public, *parts))
    for name in HYBRIDS:
        write(scenes / f"nir_{name}", HYBRID_COPIES, *hybrid(public, name))


if __name__ == "__main__":
    main()
