#include "shell_completion.h"

#include <functional>

#include <fmt/format.h>

namespace malus::app {
namespace {

void for_each_command(const CliCommand& command,
                      const std::function<void(const CliCommand&)>& visit) {
  visit(command);
  for (const auto& sub : command.commands) for_each_command(sub, visit);
}

std::string last_word(const CliCommand& command) {
  return command.name.substr(command.name.rfind(' ') + 1);
}

std::string words(const std::vector<std::string>& list) {
  std::string text;
  for (const auto& word : list) text += (text.empty() ? "" : " ") + word;
  return text;
}

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  for (auto at = text.find(from); at != std::string::npos; at = text.find(from, at + to.size()))
    text.replace(at, from.size(), to);
  return text;
}

// What stands between single quotes.
std::string in_single_quotes(const std::string& text) { return replaced(text, "'", "'\\''"); }

// An option's values by name.
const std::vector<std::string>& words_of(const CliOption& option) {
  return option.choices.empty() ? option.offers : option.choices;
}

bool offers_words(const CliCommand& command) {
  return !command.positionals.empty() && !words_of(command.positionals[0]).empty();
}

}  // namespace

// The words before the cursor name the command; then come its commands, flags, the flag's choices,
// or files (the shell's default when nothing is offered).
std::string bash_completion(const CliCommand& program) {
  std::string paths, offers, values;
  for_each_command(program, [&](const CliCommand& command) {
    const std::string path = words_after_program(command);
    std::vector<std::string> names, flags;
    for (const auto& sub : command.commands) names.push_back(last_word(sub));
    if (offers_words(command)) names = words_of(command.positionals[0]);
    for (const auto& option : command.options) {
      flags.insert(flags.end(), option.names.begin(), option.names.end());
      for (const auto& name : option.names)
        if (!option.value.empty())
          values += fmt::format("    '{} {}') values='{}' flag_takes_value=1{} ;;\n", path, name,
                                words(words_of(option)), option.or_files ? " or_files=1" : "");
    }
    if (!path.empty()) paths += fmt::format("      '{}') path='{}' ;;\n", path, path);
    offers +=
        fmt::format("    '{}') commands='{}' flags='{}' ;;\n", path, words(names), words(flags));
  });
  return fmt::format(R"(# bash completion for malus, made by malus manual
_malus() {{
  local current="${{COMP_WORDS[COMP_CWORD]}}" previous="${{COMP_WORDS[COMP_CWORD-1]}}"
  local path='' word commands='' flags='' values='' flag_takes_value='' or_files='' i
  for ((i = 1; i < COMP_CWORD; i++)); do
    word="${{path:+$path }}${{COMP_WORDS[i]}}"
    case "$word" in
{}    esac
  done
  case "$path" in
{}  esac
  case "$path $previous" in
{}  esac
  if [ -n "$flag_takes_value" ]; then
    COMPREPLY=($(compgen -W "$values" -- "$current"))
    if [ -n "$or_files" ]; then
      compopt -o filenames 2> /dev/null
      while IFS= read -r word; do COMPREPLY+=("$word"); done < <(compgen -f -- "$current")
    fi
  elif [ "${{current:0:1}}" = - ]; then
    COMPREPLY=($(compgen -W "$flags" -- "$current"))
  else
    COMPREPLY=($(compgen -W "$commands" -- "$current"))
  fi
}}
complete -o bashdefault -o default -F _malus malus
)",
                     paths, offers, values);
}

namespace {

// Brackets and colons part a specification of _arguments.
std::string zsh_escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '[' || c == ']' || c == ':' || c == '\\') out += '\\';
    out += c;
  }
  return in_single_quotes(out);
}

std::string zsh_function(const CliCommand& command) {
  return "_" + replaced(replaced(command.name, " ", "_"), "-", "_");
}

// What completes a value that has names.
std::string zsh_words(const CliOption& option) {
  const std::string list = in_single_quotes(words(words_of(option)));
  return option.or_files ? "{_malus_names_or_files " + list + "}" : "(" + list + ")";
}

std::string zsh_option(const CliOption& option) {
  std::string value, text;
  if (!option.value.empty())
    value = words_of(option).empty() ? ":" + zsh_escaped(option.value) + ":_files"
                                     : ":value:" + zsh_words(option);
  for (const auto& name : option.names)
    text += fmt::format("    '{}{}[{}]{}' \\\n", option.repeats ? "*" : "", name,
                        zsh_escaped(option.help), value);
  return text;
}

// What follows a command's flags: files, fixed words or its commands.
std::string zsh_arguments(const CliCommand& command) {
  if (offers_words(command))
    return fmt::format("    ':value:{}'\n", zsh_words(command.positionals[0]));
  if (command.commands.empty()) return "    '*:file:_files'\n";
  std::string text =
      "    '1: :->command' '*:: :->rest'\n  case $state in\n    command)\n      commands=(\n";
  for (const auto& sub : command.commands)
    text += fmt::format("        '{}:{}'\n", last_word(sub), zsh_escaped(sub.help));
  text += "      )\n      _describe command commands ;;\n    rest)\n      case $words[1] in\n";
  for (const auto& sub : command.commands)
    text += fmt::format("        {}) {} ;;\n", last_word(sub), zsh_function(sub));
  return text + "      esac ;;\n  esac\n";
}

}  // namespace

std::string zsh_completion(const CliCommand& program) {
  std::string text = "#compdef malus\n# zsh completion for malus, made by malus manual\n";
  text +=
      "\n_malus_names_or_files() {\n  _alternative \"names:name:($*)\" 'files:file:_files'\n}\n";
  for_each_command(program, [&](const CliCommand& command) {
    text += fmt::format("\n{}() {{\n  local state line\n", zsh_function(command));
    text += "  local -a commands\n  _arguments -C \\\n";
    for (const auto& option : command.options) text += zsh_option(option);
    text += zsh_arguments(command) + "}\n";
  });
  // Autoloaded, or sourced after compinit.
  return text +
         "\nif [ \"$funcstack[1]\" = _malus ]; then _malus \"$@\"; else compdef _malus malus; fi\n";
}

std::string fish_completion(const CliCommand& program) {
  const auto text_of = [](const std::string& text) {
    return replaced(replaced(text, "\\", "\\\\"), "'", "\\'");
  };
  std::string text = "# fish completion for malus, made by malus manual\n";
  for_each_command(program, [&](const CliCommand& command) {
    std::string here = "__fish_use_subcommand";
    if (const std::string path = words_after_program(command); !path.empty()) {
      here.clear();
      for (const auto& word : CLI::detail::split(path, ' '))
        here += fmt::format("{}__fish_seen_subcommand_from {}", here.empty() ? "" : "; and ", word);
    }
    std::vector<std::string> names;
    for (const auto& sub : command.commands) names.push_back(last_word(sub));
    const std::string none_yet =
        command.name == program.name
            ? here
            : fmt::format("{}; and not __fish_seen_subcommand_from {}", here, words(names));
    for (const auto& sub : command.commands)
      text += fmt::format("complete -c malus -f -n '{}' -a {} -d '{}'\n", none_yet, last_word(sub),
                          text_of(sub.help));
    if (offers_words(command))
      text += fmt::format("complete -c malus -n '{}' -a '{}'\n", here,
                          words(words_of(command.positionals[0])));
    for (const auto& option : command.options) {
      std::string line = fmt::format("complete -c malus -n '{}'", here);
      for (const auto& name : option.names)
        line += name[1] == '-' ? " -l " + name.substr(2) : " -s " + name.substr(1);
      if (!words_of(option).empty())
        line += fmt::format(" {} -a '{}'", option.or_files ? "-r" : "-x", words(words_of(option)));
      else if (!option.value.empty())
        line += " -r";
      text += fmt::format("{} -d '{}'\n", line, text_of(option.help));
    }
  });
  return text;
}

}  // namespace malus::app
