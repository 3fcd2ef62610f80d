"""From frames to plots: measure a camera, compare its noise with the model's, denoise a polarization frame.

A notebook as a script: editors that know `# %%` run it cell by cell. As a program it writes its plots into a folder:

    python3 frames_to_plots.py [FOLDER]
"""
# %% Where the sample frames are, and where plots go
import pathlib
import sys

import malus
import matplotlib

if "ipykernel" not in sys.modules:
    matplotlib.use("Agg")  # no screen needed
import matplotlib.pyplot as plt
import numpy as np

try:
    examples = pathlib.Path(__file__).resolve().parents[1]
except NameError:  # in a notebook, which runs in this folder
    examples = pathlib.Path.cwd().parent
folder = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 and not sys.argv[1].startswith("-") else "plots")
folder.mkdir(parents=True, exist_ok=True)

# %% A session: flats at rising exposure, two frames each, and bias frames
session = malus.Session(examples / "emva/session.toml")
signal, variance = [], []
for number, group in enumerate(session.groups):
    if group.kind != "flat":
        continue
    first, second = (session.load(number, i).dn for i in range(2))
    if np.mean(first >= 4095) > 0.01:
        continue  # saturated
    signal.append((first.mean() + second.mean()) / 2)
    variance.append((first - second).var() / 2)  # the fixed pattern falls out of the difference

# %% The same frames through calibration: gain K and dark noise with their standard errors
model = malus.calibrate(session)
gain = model.as_dict()["gains"][0]
K, K_error = gain["K"]["value"][0], gain["K"]["stderr"][0]
dark_sd, bias = gain["temporal_sd_dark"]["value"][0], gain["mu"]["mean"][0]
print(f"K = {K:.4f} +- {K_error:.4f} DN/e-, dark noise {dark_sd:.2f} DN")

# %% Photon transfer: the measured variances and the line that the model stands for
figure, axes = plt.subplots()
axes.plot(signal, variance, "o", label="pairs of frames")
line = np.linspace(bias, max(signal), 2)
axes.plot(line, dark_sd**2 + K * (line - bias), label=f"K = {K:.3f} DN/e-")
axes.set(xlabel="mean [DN]", ylabel="temporal variance [DN$^2$]", title="Photon transfer")
axes.legend()
figure.savefig(folder / "photon_transfer.png")

# %% Dark frames of the camera against dark frames that the model draws
number = max(range(len(session.groups)), key=lambda i: len(session.groups[i].paths))
real = np.stack([session.load(number, i).dn for i in range(len(session.groups[number].paths))])
dark = np.zeros_like(real[0])
drawn = np.stack([np.round(model.synthesize(dark, seed=1, frame=i, quantization=False)) for i in range(len(real))])
distance = malus.compare_noise(real, drawn, "mono", remove_fixed_pattern=True)
figure, axes = plt.subplots()
for frames, name in ((real, "camera"), (drawn, "model")):
    axes.hist((frames - frames.mean(axis=0)).ravel(), bins=np.arange(-15, 16) - 0.5, density=True, histtype="step", label=name)
axes.set(xlabel="dark noise [DN]", yscale="log", title=f"sqrt(JSD) = {distance['sqrt_jsd']:.4f}")
axes.legend()
figure.savefig(folder / "dark_noise.png")

# %% A raw polarization frame, denoised (the noise estimated from the picture), and its degree of linear polarization
frame = malus.load_frame(examples / "imx250mzr/camera.png", layout="polar-mono", black=0)
denoised = malus.denoise(frame, profile="fast")["dn"]
figure, axes = plt.subplots(1, 2, figsize=(10, 4.5))
for pixels, name, ax in ((frame.dn, "raw", axes[0]), (denoised, "denoised", axes[1])):
    ax.imshow(malus.stokes(pixels, "polar-mono")["dolp"][0], vmin=0, vmax=1, cmap="viridis")
    ax.set(title=f"DoLP, {name}", xticks=[], yticks=[])
figure.tight_layout()
figure.savefig(folder / "dolp.png")
print("plots:", *sorted(path.name for path in folder.glob("*.png")))
