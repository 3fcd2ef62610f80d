#!/usr/bin/env bash
# The shipped networks beside the classical default, for the two kinds of sensor that they were trained for: what ./quickstart runs last.
#   examples/networks_job.sh PROGRAM FOLDER
set -euo pipefail
malus="$1"
results="$2/networks"
examples="$(dirname "$0")"
mkdir -p "$results"
say() { printf '\n== %s\n' "$*"; }
run() { echo "\$ malus $*"; "$malus" "$@"; }

# The same still life as both sensors see it in a tenth of the light.   compare LAYOUT FULL-SCALE NETWORK MODEL GAIN...
compare() {
  local layout="$1" full_scale="$2" network="$3" camera="$4"; shift 4
  local folder="$results/$layout" polarized=() frame=still_life_clean_000
  [ "${layout#polar}" = "$layout" ] || polarized=(--polarized)
  local noise=(--model "$camera" "$@") light=(--black 0 --ratio 10)
  run simulate "$examples/still_life/still_life.exr" --layout "$layout" "${polarized[@]}" --full-scale "$full_scale" -o "$folder" --force
  run synthesize "$folder/still_life_clean.tif" "${noise[@]}" "${light[@]}" --seed 1 -o "$folder" --force
  run synthesize "$folder/still_life_clean.tif" "${noise[@]}" "${light[@]}" --seed 1 --float -o "$folder/noisy" --force
  run denoise "$folder/$frame.tif" "${noise[@]}" -o "$folder/default" --force
  run denoise "$folder/$frame.tif" "${noise[@]}" --method "$network" -o "$folder/network" --report "$folder/network.html" --force
  run evaluate --reference "$folder/still_life_clean.tif" --layout "$layout" --white "$full_scale" "${light[@]}" \
    --test "$folder/noisy/$frame.tif" "$folder/default/${frame}_denoised.tif" "$folder/network/${frame}_denoised.tif"
}

models="$examples/../models"
say "4. Colour polarization: a still life with a relief, at 24 dB; noisy, the classical default, the network"
compare polar-bayer-rggb 3800 "$models/polar-bayer.safetensors" imx250myr-simulated --gain 24
say "5. Bayer: the same picture at ISO 6400; noisy, the classical default, the network"
compare bayer-rggb 15000 "$models/bayer.safetensors" sony-a7s2 --iso 6400

printf '\nDone. Look at:\n'
printf '  %s\n' "$results/polar-bayer-rggb/network.html  before and after, every plane" "$results/bayer-rggb/network.html"
