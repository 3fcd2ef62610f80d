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
  echo
  echo "Results go to standard output: text, or one JSON object with \`--json\`. Notes, warnings, errors and the progress bar (on a"
  echo "terminal only) go to standard error; an error is one line: which file, what is wrong, what to do. Exit codes: 0 done; 1 the"
  echo "input or the machine is at fault; 2 wrong usage: flags that exclude each other, or a value that is wrong whatever the files"
  echo "hold; 130 stopped by SIGTERM, or by Ctrl-C as a shell sees it: the program then ends by SIGINT itself, so that a shell's loop"
  echo "ends with it. Outputs appear whole or not at all; those that exist are replaced with \`--force\` only, and so is the same result in"
  echo "another format: where \`--format exr\` is asked for and \`frame_denoised.tif\` is there, \`--force\` takes it away."
  echo
  echo "A flag that takes several words (\`--kind physics gaussian\`, or \`physics,gaussian\` where help says so) ends with the first word that"
  echo "is none of its own. Of files nobody can tell: their list goes on to the next flag, or to \`--\`."
  echo
  echo "A file that holds several frames, a [stack](session.md#stacks), counts as its frames where a command takes several, and"
  echo "results are named by them: \`stack_000_denoised.tif\`. \`stack.tif[3]\` names one of them, counted from 0."
  echo
  echo "Commands that write results of raw frames, one by one, read the headers of all of them first. Where a later frame or picture"
  echo "turns out to be damaged, or Ctrl-C ends the run, the results of those before it are printed all the same."
  document
} > docs/commands.md
