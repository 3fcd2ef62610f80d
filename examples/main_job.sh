#!/usr/bin/env bash
# The main job on the sample frames of this folder: what ./quickstart runs after it has built the program.
#   examples/main_job.sh PROGRAM FOLDER
set -euo pipefail
malus="$1"
results="$2"
examples="$(dirname "$0")"
mkdir -p "$results"
say() { printf '\n== %s\n' "$*"; }
run() { echo "\$ malus $*"; "$malus" "$@"; }

say "1. A real camera's noise, measured from its own frames (EMVA 1288 sample: bright and dark frames)"
run calibrate "$examples/emva/session.toml" -o "$results/emva.h5" --report "$results/calibration.html" --force

say "2. Real raw polarization frames (Sony IMX250MZR), denoised; the noise model is estimated from each picture"
run info "$examples/imx250mzr/fruits.png" --layout polar-mono
run denoise "$examples"/imx250mzr/{fruits,carps,camera}.png --layout polar-mono --black 0 --white 255 -o "$results/denoised" \
  --report "$results/denoised.html" --force
run stokes "$results"/denoised/{fruits,carps,camera}_denoised.tif --layout polar-mono -o "$results/stokes" --force

say "3. The numbers: the same scene at 24 dB and a tenth of the light, drawn from a noise model and denoised with it"
scene="$examples/imx250mzr/carps_12bit.png"
sensor=(--layout polar-mono --white 4080)
dark="$results/dark"
run synthesize "$scene" "${sensor[@]}" --black 0 --model imx250mzr-simulated --gain 24 --ratio 10 --seed 1 -o "$dark" --force
run denoise "$dark/carps_12bit_000.tif" --model imx250mzr-simulated --gain 24 -o "$dark" --force
run synthesize "$scene" "${sensor[@]}" --black 0 --model imx250mzr-simulated --gain 24 --ratio 10 --seed 1 --float \
  -o "$dark/noisy" --force
run evaluate --reference "$scene" "${sensor[@]}" --black 0 --ratio 10 \
  --test "$dark/noisy/carps_12bit_000.tif" "$dark/carps_12bit_000_denoised.tif"

printf '\nDone. Look at:\n'
printf '  %s\n' "$results/denoised.html    before and after, every plane" \
  "$results/calibration.html the measured camera" \
  "$results/stokes/          S0, S1, S2, DoLP and AoLP as pictures and EXR" \
  "$results/emva.h5          the noise model (malus model show)"
