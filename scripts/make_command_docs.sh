#!/usr/bin/env bash
# Writes docs/commands.md from the program's own --help.   scripts/make_command_docs.sh [PROGRAM]
set -euo pipefail
cd "$(dirname "$0")/.."
malus="${1:-build/release/malus}"
{
  echo "# Commands"
  echo
  echo "Made from \`malus --help\` by \`scripts/make_command_docs.sh\`; a test compares it with the program."
  for command in "" $("$malus" --help | sed -n '/^Subcommands:/,$p' | awk 'NR>1 && /^  [a-z]/ {print $1}'); do
    echo; echo "## malus $command"; echo; echo '```'
    "$malus" $command --help
    echo '```'
  done
} > docs/commands.md
