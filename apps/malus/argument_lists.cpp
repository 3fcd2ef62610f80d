#include "argument_lists.h"

#include "malus/base/text.h"

#include <algorithm>

#include <fmt/format.h>

namespace malus::app {
namespace {

// Null where there is none.
CLI::Validator* check_of(CLI::Option& option) {
  try {
    return option.get_validator(0);
  } catch (const CLI::OptionNotFound&) {
    return nullptr;
  }
}

bool takes_list(const CLI::Option& option) {
  return option.get_items_expected_max() > 1 && option.get_allow_extra_args();
}

bool is_flag(const std::string& word) { return word.starts_with('-') && word != "-"; }

// A word of several values has them between the delimiters.
bool accepts(CLI::Option& option, const std::string& word) {
  const CLI::Validator* check = check_of(option);
  const char delimiter = option.get_delimiter();
  for (std::string value :
       delimiter == '\0' ? std::vector{word} : CLI::detail::split(word, delimiter))
    if (!(*check)(value).empty()) return false;
  return true;
}

// The flag of this word where its list ends by its check; null of every other word.
CLI::Option* list_of(CLI::App& command, const std::string& word) {
  if (!word.starts_with("--")) return nullptr;
  CLI::Option* option = command.get_option_no_throw(word.substr(0, word.find('=')));
  return option && takes_list(*option) && check_of(*option) ? option : nullptr;
}

}  // namespace

std::vector<std::string> with_lists_ended(CLI::App& program,
                                          const std::vector<std::string>& arguments) {
  std::vector<std::string> ended;
  CLI::App* command = &program;
  bool all_positional = false;  // after the user's own "--"
  for (std::size_t i = 0; i < arguments.size();) {
    const std::string& word = arguments[i++];
    ended.push_back(word);
    all_positional = all_positional || word == "--";
    for (CLI::App* next : command->get_subcommands([](CLI::App*) { return true; }))
      if (next->check_name(word)) command = next;
    CLI::Option* list = all_positional ? nullptr : list_of(*command, word);
    if (!list) continue;
    const auto follows = [&] { return i < arguments.size() && !is_flag(arguments[i]); };
    if (word.find('=') == std::string::npos && follows()) ended.push_back(arguments[i++]);
    while (follows() && accepts(*list, arguments[i])) ended.push_back(arguments[i++]);
    if (follows())
      ended.emplace_back("--");
    else if (i < arguments.size() && arguments[i] == "--")  // the parser takes it for the same
      ended.push_back(arguments[i++]);
  }
  return ended;
}

std::string taken_by_lists(const CLI::App& command) {
  const auto options = command.get_options();
  if (std::ranges::none_of(options, [](const CLI::Option* option) {
        return option->get_positional() && option->get_required() && option->count() == 0;
      }))
    return {};
  std::string taken;
  for (const CLI::Option* option : options)
    if (!option->get_positional() && takes_list(*option) && option->count() > 1)
      taken += fmt::format("; {} took {}: write -- behind the last of its own", option->get_name(),
                           joined(option->results()));
  return taken;
}

}  // namespace malus::app
