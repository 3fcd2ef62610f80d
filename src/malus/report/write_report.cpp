#include "malus/report/write_report.h"

#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/report/internal/embedded_page.h"
#include "malus/report/internal/json.h"
#include "malus/report/internal/svg.h"

#include <cctype>
#include <set>
#include <utility>

#include <fmt/format.h>

namespace malus {
namespace {

constexpr std::string_view kPlaceholder = "<!--malus-data-->";

// Inside a script element only "</script" and "<!--" could end or open something: no '<' is left.
std::string script_safe(std::string json) {
  std::string safe;
  safe.reserve(json.size());
  for (const char character : json) {
    if (character == '<')
      safe += "\\u003c";
    else
      safe += character;
  }
  return safe;
}

// The letters that plots' titles have, for file names that every system and LaTeX take.
std::string spelled_out(std::string text) {
  static constexpr std::pair<std::string_view, std::string_view> kLetters[] = {
      {"μ", "mu"}, {"σ", "sigma"}, {"λ", "lambda"}, {"χ", "chi"}, {"²", "2"}};
  for (const auto& [letter, word] : kLetters)
    for (std::size_t at = 0; (at = text.find(letter, at)) != std::string::npos; at += word.size())
      text.replace(at, letter.size(), word);
  return text;
}

bool is_letter_or_digit(char character) {
  return std::isalnum(static_cast<unsigned char>(character)) != 0;
}

// "at -3 dB", but not "0-3 dB".
bool is_minus(const std::string& text, std::size_t at) {
  return text[at] == '-' && (at == 0 || !is_letter_or_digit(text[at - 1])) &&
         at + 1 < text.size() && std::isdigit(static_cast<unsigned char>(text[at + 1])) != 0;
}

std::string file_stem(const std::string& title) {
  const std::string text = spelled_out(title);
  std::string stem;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (is_letter_or_digit(text[i]) || text[i] == '.')
      stem += text[i];
    else if (!stem.empty() && stem.back() != '_')
      stem += '_';
    if (is_minus(text, i)) stem += "minus";
  }
  while (!stem.empty() && stem.back() == '_') stem.pop_back();
  return stem;
}

// Titles that name the choice ("Bias at 12 dB") need no second "12 dB" behind them.
bool titles_tell_apart(const ChartsBlock& block) {
  std::set<std::string> stems;
  for (const auto& [name, chart] : block.charts) stems.insert(file_stem(chart.title));
  return stems.size() == block.charts.size();
}

struct Figure {
  std::filesystem::path path;
  const Chart* chart = nullptr;
};

// Charts of the same name are numbered from the second on.
std::vector<Figure> figures_of(const Report& report, const std::filesystem::path& folder) {
  std::vector<Figure> figures;
  std::set<std::string> taken;
  for (const Section& section : report.sections)
    for (const Block& block : section.blocks) {
      const auto* charts = std::get_if<ChartsBlock>(&block);
      if (charts == nullptr) continue;
      const bool titles_suffice = titles_tell_apart(*charts);
      for (const auto& [name, chart] : charts->charts) {
        const std::string stem =
            file_stem(fmt::format("{}_{}_{}", section.id, chart.title, titles_suffice ? "" : name));
        std::string unlike = stem;
        for (int number = 2; !taken.insert(unlike).second; ++number)
          unlike = fmt::format("{}_{}", stem, number);
        figures.push_back({folder / (unlike + ".svg"), &chart});
      }
    }
  return figures;
}

}  // namespace

std::string report_html(const Report& report, const ReportSettings& settings) {
  std::vector<internal::Blob> blobs;
  const internal::Json json = internal::report_json(report, settings, blobs);
  // Names may hold invalid UTF-8: replaced, never a reason to fail.
  std::string data =
      "<script type=\"application/json\" id=\"malus-report\">" +
      script_safe(json.dump(-1, ' ', false, internal::Json::error_handler_t::replace)) +
      "</script>\n";
  for (const auto& [id, text] : blobs)
    data += "<script type=\"text/plain\" id=\"" + id + "\">" + text + "</script>\n";
  const std::string_view page = internal::embedded_page();
  const std::size_t at = page.find(kPlaceholder);
  MALUS_REQUIRE(at != std::string_view::npos);
  std::string html(page.substr(0, at));
  html += data;
  html += page.substr(at + kPlaceholder.size());
  return html;
}

void write_report(const Report& report, const std::filesystem::path& path,
                  const ReportSettings& settings) {
  check_output(path, settings.force);
  write_file(path, report_html(report, settings), settings.force);
}

void check_figures(const Report& report, const std::filesystem::path& folder, bool force) {
  make_output_folder(folder);
  for (const auto& [path, chart] : figures_of(report, folder)) check_output(path, force);
}

std::vector<std::filesystem::path> write_figures(const Report& report,
                                                 const std::filesystem::path& folder, bool force) {
  check_figures(report, folder, force);
  std::vector<std::filesystem::path> written;
  for (const auto& [path, chart] : figures_of(report, folder)) {
    write_file(path, chart_svg(*chart), force);
    written.push_back(path);
  }
  return written;
}

}  // namespace malus
