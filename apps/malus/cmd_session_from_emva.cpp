// malus session-from-emva: an EMVA 1288 measurement's description becomes a session file.
#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/io/emva_description.h"

#include <cstdint>
#include <filesystem>
#include <iterator>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "flags.h"
#include "output_check.h"
#include "program.h"
#include <fmt/format.h>

namespace malus::app {

void add_session_from_emva(CLI::App& app, Common& common) {
  struct Arguments {
    std::filesystem::path description, output;
    std::string name;
    std::optional<double> gain_db;
  };
  const auto arguments = std::make_shared<Arguments>();
  CLI::App* command =
      add_command(app, common, "session-from-emva", "Convert EMVA1288_Data.txt to a session file",
                  {.force = true}, [arguments, &common] {
                    EmvaSession converted = load_emva_description(arguments->description);
                    Session& session = converted.session;
                    session.sensor.name = arguments->name;
                    std::int64_t frames = 0;
                    for (FrameGroup& group : session.groups) {
                      group.gain.gain_db = arguments->gain_db;
                      frames += std::ssize(group.paths);
                    }
                    std::vector<std::filesystem::path> read = files_read(session);
                    read.push_back(arguments->description);
                    check_output_apart("--output", arguments->output, read, {}, common.force);
                    save_session(arguments->output, session, common.force);
                    for (const auto& line : converted.notes) warn(line);
                    print_result(common,
                                 {{"session", arguments->output.string()},
                                  {"groups", session.groups.size()},
                                  {"frames", frames},
                                  {"missing_images", converted.missing_images}},
                                 fmt::format("{}: {}, {}", arguments->output.string(),
                                             counted(std::ssize(session.groups), "set"),
                                             counted(frames, "frame")));
                  });
  command->add_option("DATA", arguments->description, "the description beside the images")
      ->required();
  command->add_option("-o,--output", arguments->output, "session file to write")->required();
  command->add_option("--name", arguments->name, "name of the sensor");
  command->add_option("--gain", arguments->gain_db, "camera gain of the measurement [dB]")
      ->check(gain_in_db());
}

}  // namespace malus::app
