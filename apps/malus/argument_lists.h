// Where on the command line a flag's list of words ends.
#pragma once

#include <string>
#include <vector>

#include <CLI/CLI.hpp>

namespace malus::app {

/// The arguments with "--" behind the list of every flag that takes several words and checks them
/// (`--kind physics gaussian`), before the first word that it would refuse: what follows is another
/// argument's, a positional's. CLI11 gives a flag all words up to the next flag. A list's first
/// word is the flag's, whatever it is.
std::vector<std::string> with_lists_ended(CLI::App& program,
                                          const std::vector<std::string>& arguments);

/// What goes behind the line that the command misses a positional: which flags may have it, that
/// cannot tell where their lists end. Empty where nothing is missing, or no flag took several
/// words.
std::string taken_by_lists(const CLI::App& command);

}  // namespace malus::app
