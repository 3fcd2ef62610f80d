"""A captured session with known truth: a simulated polarization camera takes references and short frames of two scenes."""

import numpy as np

CAMERA = "imx250myr-simulated"
BLACK, WHITE = 82, 4095
SIDE = 288


def scene(number):
    """Clean mosaic, DN above black: waves through rotated polarizers, and in scene 1 a lamp that white cuts off."""
    rows, cols = np.mgrid[0:SIDE, 0:SIDE]
    angle = np.array([[90, 45], [135, 0]])[rows % 2, cols % 2]
    light = 1500 + 600 * np.sin(cols / 13 + number) + 400 * np.cos(rows / 9)
    light[SIDE // 2:] *= 0.6
    dolp = 0.3 + 0.25 * np.sin(rows / 17 + number)
    aolp = 40 + 60 * np.cos(cols / 31)
    mosaic = light / 2 * (1 + dolp * np.cos(2 * np.radians(angle - aolp)))
    if number == 1:
        mosaic[(rows - 40) ** 2 + (cols - 70) ** 2 < 400] = 9000
    return mosaic.astype(np.float32)


def capture(malus, folder, shorts=((12, 10), (24, 10)), references=8):
    """(session file, clean mosaics). shorts: gain [dB] and ratio of each scene's short sets; the references are at 0 dB."""
    folder.mkdir()
    session, scenes = ['[sensor]\nname = "simulated"\n'], [scene(0), scene(1)]
    for number, clean in enumerate(scenes):
        np.save(folder / f"clean{number}.npy", np.minimum(clean, WHITE - BLACK))
        for index, (kind, gain, ratio, frames) in enumerate([("reference", 0, 1, references), *(("short", *short, 3) for short in shorts)]):
            taken = folder / f"{kind}{index}"
            malus("synthesize", folder / f"clean{number}.npy", "--model", CAMERA, "--gain", gain, "--ratio", ratio, "--frames", frames,
                  "--seed", 100 * number + index, "-o", taken)
            seconds = 0.1 / ratio / 10 ** (gain / 20)
            session.append(f'[[frames]]\nkind = "{kind}"\nlevel = {number}\ngain_db = {gain}\nexposure_s = {seconds}\n'
                           f'paths = ["{taken.name}/clean{number}_*.tif"]\n')
    (folder / "session.toml").write_text("\n".join(session))
    return folder / "session.toml", scenes
