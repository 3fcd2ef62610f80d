#!/usr/bin/env bash
# docs/result.jpg from what ./quickstart left: intensity above, DoLP below; raw left, denoised right.
#   scripts/make_result_picture.sh PROGRAM RESULTS docs/result.jpg
set -euo pipefail
malus="$1" dark="$2/dark" picture="$3"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
"$malus" stokes "$dark/noisy/carps_12bit_000.tif" "$dark/carps_12bit_000_denoised.tif" --layout polar-mono -o "$work" -q >/dev/null
/usr/bin/python3 - "$work" "$picture" <<'PY'
import sys

from PIL import Image

work, picture = sys.argv[1:]
width, height = 500, 418
sheet = Image.new("RGB", (2 * width, 2 * height))
for column, stem in enumerate(("carps_12bit_000", "carps_12bit_000_denoised")):
    for row, kind in enumerate(("s0", "dolp")):
        part = Image.open(f"{work}/{stem}_{kind}.png").resize((width, height), Image.LANCZOS)
        sheet.paste(part, (column * width, row * height))
sheet.save(picture, quality=90)
PY
