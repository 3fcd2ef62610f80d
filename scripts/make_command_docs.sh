#!/usr/bin/env bash
# Writes docs/commands.md from the program's own --help.   scripts/make_command_docs.sh [PROGRAM]
set -euo pipefail
cd "$(dirname "$0")/.."
malus="${1:-build/release/malus}"

# A section for the words of one command, then those of its subcommands.
document() {
  local help subcommand
  help="$("$malus" "$@" --help)"
  printf '\n## malus%s\n\n```\n%s\n```\n' "${*:+ $*}" "$help"
  for subcommand in $(sed -n '/^Subcommands:/,$p' <<<"$help" | awk 'NR>1 && /^  [a-z]/ {print $1}'); do
    document "$@" "$subcommand"
  done
}

{
  echo "# Commands"
  echo
  echo "Made from \`malus --help\` by \`scripts/make_command_docs.sh\`; a test compares it with the program."
  document
} > docs/commands.md
