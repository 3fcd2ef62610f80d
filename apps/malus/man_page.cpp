#include "man_page.h"

#include <algorithm>

#include <fmt/format.h>

namespace malus::app {
namespace {

// Backslashes, hyphens that are typed, and lines that would be taken for requests.
std::string roff(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '\\')
      out += "\\e";
    else if (c == '-')
      out += "\\-";
    else
      out += c;
  }
  if (!out.empty() && (out[0] == '.' || out[0] == '\'')) out.insert(0, "\\&");
  return out;
}

std::string sentence(std::string text) {
  if (!text.empty()) text[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(text[0])));
  return text;
}

std::string upper(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  return text;
}

std::string synopsis(const CliCommand& command) {
  std::string text = fmt::format(".B {}\n", roff(command.name));
  if (!command.options.empty()) text += "[\\fIoptions\\fR]\n";
  for (const auto& positional : command.positionals) {
    const std::string name = roff(upper(positional.names[0])) + (positional.repeats ? "..." : "");
    text += positional.required ? fmt::format("\\fI{}\\fR\n", name)
                                : fmt::format("[\\fI{}\\fR]\n", name);
  }
  if (!command.commands.empty()) text += "\\fIcommand\\fR ...\n";
  return text;
}

std::string entry(const CliOption& option, bool positional) {
  std::string head;
  for (const auto& name : option.names)
    head += fmt::format("{}\\fB{}\\fR", head.empty() ? "" : ", ",
                        roff(positional ? upper(name) : name));
  if (!option.value.empty() && !positional)
    head += fmt::format(" \\fI{}\\fR{}", roff(option.value), option.repeats ? " ..." : "");
  std::string text = fmt::format(".TP\n{}\n{}", head, roff(sentence(option.help)));
  if (!option.choices.empty()) {
    text += "\nOne of";
    for (const auto& choice : option.choices)
      text +=
          fmt::format(" \\fB{}\\fR{}", roff(choice), &choice == &option.choices.back() ? "" : ",");
  }
  if (!option.default_value.empty() && !option.value.empty())
    text += fmt::format("\n(default {})", roff(option.default_value));
  return text + "\n";
}

// Options in the groups of --help, the ungrouped ones first.
std::string options_text(const CliCommand& command) {
  std::vector<std::string> groups;
  for (const auto& option : command.options)
    if (std::find(groups.begin(), groups.end(), option.group) == groups.end())
      groups.push_back(option.group);
  std::string text;
  for (const auto& positional : command.positionals) text += entry(positional, true);
  for (const auto& group : groups) {
    if (group != "Options") text += fmt::format(".SS {}\n", roff(group));
    for (const auto& option : command.options)
      if (option.group == group) text += entry(option, false);
  }
  return text;
}

constexpr const char* kExitStatus =
    ".SH EXIT STATUS\n"
    ".TP\n0\ndone\n"
    ".TP\n1\nthe input or the environment is at fault: one line says which file, what is wrong and "
    "what to do\n"
    ".TP\n2\nwrong usage\n"
    ".TP\n130\nstopped on request (after Ctrl-C by SIGINT itself, which a shell calls 130)\n";

std::string references(const CliCommand& command) {
  std::string text = ".SH SEE ALSO\n";
  if (command.commands.empty() || !words_after_program(command).empty())
    return text + ".BR malus (1)\n";
  for (const auto& sub : command.commands)
    text += fmt::format(".BR {} (1){}\n", roff(man_page_name(sub)),
                        &sub == &command.commands.back() ? "" : ",");
  return text;
}

}  // namespace

std::string man_page_name(const CliCommand& command) {
  std::string name = command.name;
  std::replace(name.begin(), name.end(), ' ', '-');
  return name;
}

std::string man_page(const CliCommand& command, const std::string& version) {
  const std::string name = man_page_name(command);
  std::string text =
      fmt::format(".TH {} 1 \"\" \"malus {}\" \"malus manual\"\n", roff(upper(name)), version);
  text += fmt::format(".SH NAME\n{} \\- {}\n", roff(name), roff(command.help));
  text += ".SH SYNOPSIS\n" + synopsis(command);
  text += fmt::format(".SH DESCRIPTION\n{}.\n", roff(sentence(command.help)));
  const bool program = words_after_program(command).empty();
  if (program)
    text +=
        "Every command answers to \\fB\\-\\-help\\fR and, with \\fB\\-\\-json\\fR, prints one JSON "
        "object on standard output.\n";
  const std::string options = options_text(command);
  if (!options.empty()) text += ".SH OPTIONS\n" + options;
  if (!command.commands.empty()) text += ".SH COMMANDS\n";
  for (const auto& sub : command.commands) {
    text += fmt::format(".TP\n\\fB{}\\fR\n{}\n", roff(words_after_program(sub)),
                        roff(sentence(sub.help)));
  }
  for (const auto& sub : command.commands)
    if (!program && !(sub.options.empty() && sub.positionals.empty()))
      text += fmt::format(".SH OPTIONS OF {}\n", roff(upper(words_after_program(sub)))) +
              options_text(sub);
  return text + kExitStatus + references(command);
}

}  // namespace malus::app
