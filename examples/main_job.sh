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

say "1. A real camera's noise, measured from its own frames (EMVA 1288 sample: bright and dark pairs)"
run calibrate "$examples/emva/session.toml" -o "$results/emva.h5" --force --report "$results/emva.html"
run model show "$results/emva.h5"

say "2. Real raw polarization frames (Sony IMX250MZR): denoised, with a noise model estimated from each picture"
run info "$examples/imx250mzr/fruits.png" --layout polar-mono
run denoise "$examples/imx250mzr/"{fruits,carps,camera}.png --layout polar-mono -o "$results/denoised" --force \
  --report "$results/denoised.html"
run stokes "$results/denoised/"{fruits,carps,camera}_denoised.tif --layout polar-mono -o "$results/stokes" --force

say "3. The same scene in a tenth of the light: noise drawn from a model, removed with it, compared with the start"
run synthesize "$examples/imx250mzr/carps.png" --layout polar-mono --black 0 --white 255 --model imx250mzr-simulated --gain 24 \
  --ratio 10 --scale 16 -o "$results/dark" --force
