// malus manual: man pages and shell completion, made from the declarations of the commands.
#include "malus/base/atomic_file.h"
#include "malus/base/error.h"

#include <filesystem>
#include <memory>

#include "cli_tree.h"
#include "man_page.h"
#include "program.h"
#include "shell_completion.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

void write_manual(const Common& common, const CLI::App& app, const std::filesystem::path& folder) {
  const CliCommand program = describe_cli(app);
  std::vector<std::filesystem::path> written;
  const auto write = [&](const std::filesystem::path& name, const std::string& text) {
    make_output_folder((folder / name).parent_path());
    write_file(folder / name, text, common.force);
    written.push_back(folder / name);
  };
  const std::filesystem::path man = "man/man1";
  write(man / (man_page_name(program) + ".1"), man_page(program, MALUS_VERSION));
  for (const auto& command : program.commands)
    write(man / (man_page_name(command) + ".1"), man_page(command, MALUS_VERSION));
  write("bash-completion/completions/malus", bash_completion(program));
  write("zsh/vendor-completions/_malus", zsh_completion(program));
  write("fish/vendor_completions.d/malus.fish", fish_completion(program));
  nlohmann::ordered_json json = nlohmann::ordered_json::array();
  std::string text;
  for (const auto& path : written) {
    json.push_back(path.string());
    text += path.string() + "\n";
  }
  print_result(common, {{"files", json}}, text);
}

}  // namespace

void add_manual(CLI::App& app, Common& common) {
  const auto folder = std::make_shared<std::filesystem::path>();
  CLI::App* command =
      add_command(app, common, "manual", "Man pages and completion for bash, zsh and fish",
                  {.force = true}, [&app, &common, folder] { write_manual(common, app, *folder); });
  command->add_option("-o,--output", *folder, "folder to write them to, laid out as /usr/share is")
      ->required();
}

}  // namespace malus::app
