#include "malus/report/write_report.h"

#include "malus/base/error.h"
#include "malus/report/internal/svg.h"

#include <cmath>
#include <fstream>
#include <random>
#include <regex>
#include <sstream>

#include "support.h"
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace malus {
namespace {

using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::Not;

PicturesBlock pictures_of(int rows, int cols, double noise_sd) {
  std::mt19937 engine(5);
  std::normal_distribution<double> gauss;
  PicturesBlock block{.title = "scene",
                      .text = {},
                      .layout = SensorLayout::named("polar-bayer-rggb"),
                      .rows = rows,
                      .cols = cols};
  for (const double part : {1.0, 0.2}) {
    ReportPicture picture{part == 1 ? "before" : "after", Image(rows, cols), part};
    for (float& value : picture.dn.values())
      value = static_cast<float>(100 + part * noise_sd * gauss(engine));
    block.pictures.push_back(std::move(picture));
  }
  block.noise.assign(16, {0, noise_sd * noise_sd});
  return block;
}

Report report_of(Block block) {
  return {.title = "t", .subtitle = "s", .sections = {{"one", "One", "", {std::move(block)}}}};
}

TEST(WriteReport, HostileTextCannotLeaveItsScriptElement) {
  Report report = report_of(TextBlock{{"</script><script>alert(1)</script><!--"}});
  report.title = "<script>alert(2)</script>";
  const std::string html = report_html(report);
  EXPECT_THAT(html, Not(HasSubstr("<script>alert")));
  EXPECT_THAT(html, HasSubstr("\\u003c/script>\\u003cscript>alert(1)"));
}

TEST(WriteReport, InvalidUtf8IsReplaced) {
  EXPECT_THAT(report_html(report_of(TextBlock{{"sensor \xff\xfe"}})),
              HasSubstr("sensor \xEF\xBF\xBD"));
}

TEST(WriteReport, PageAllowsNoNetwork) {
  const std::string html = report_html(report_of(TextBlock{{"x"}}));
  EXPECT_THAT(html, HasSubstr("default-src 'none'"));
  EXPECT_THAT(html, Not(HasSubstr(" src=\"")));
  EXPECT_THAT(html, Not(HasSubstr("rel=\"stylesheet\"")));
}

TEST(WriteReport, NumbersThatAreNotFiniteBecomeNull) {
  FiguresBlock figures;
  figures.items.push_back({"K", "K", "DN/e-", "", {0.25, NAN}});
  EXPECT_THAT(report_html(report_of(figures)), HasSubstr(R"("value":0.25,"error":null)"));
}

TEST(WriteReport, PicturesKeepWithinTheBudget) {
  for (const double budget_mib : {0.02, 0.1, 0.5}) {
    const std::string empty = report_html(report_of(TextBlock{{"x"}}));
    const std::string html =
        report_html(report_of(pictures_of(512, 512, 8)), {.picture_budget_mib = budget_mib});
    EXPECT_LT(static_cast<double>(html.size() - empty.size()),
              1.1 * budget_mib * (1 << 20) + 20'000)
        << budget_mib;
  }
}

TEST(WriteReport, IntegersAreStoredExactlyWhereThatIsNoFinerThanTheNoise) {
  PicturesBlock block = pictures_of(64, 64, 8);
  for (float& value : block.pictures[0].dn.values()) value = std::round(value);
  const std::string html = report_html(report_of(block));
  EXPECT_THAT(html, HasSubstr(R"("exact":true)"));
  EXPECT_THAT(html, HasSubstr(R"("exact":false)"));
}

TEST(WriteReport, OddSizesAndOnePixelAreWritten) {
  for (const auto& [rows, cols] : {std::pair{1, 1}, {5, 3}, {4, 4}, {3, 130}})
    EXPECT_FALSE(report_html(report_of(pictures_of(rows, cols, 2))).empty());
}

TEST(WriteReport, AnExistingFileNeedsForce) {
  const testing::TemporaryFolder folder;
  const Report report = report_of(TextBlock{{"x"}});
  write_report(report, folder / "r.html");
  EXPECT_THROW(write_report(report, folder / "r.html"), InputError);
  EXPECT_NO_THROW(write_report(report, folder / "r.html", {.force = true}));
}

TEST(ChannelTable, ValuesAndErrorsStandBesideTheirChannel) {
  const auto layout = SensorLayout::named("bayer-rggb");
  const TableBlock table = channel_table(
      "t", layout,
      {{"K", "K", "DN/e-", "gain", {1, 2, 3, 4}, {.1, .2, .3, .4}}, {"m", "μ", "DN", "", {5}, {}}});
  ASSERT_EQ(table.rows.size(), 4U);
  EXPECT_EQ(table.rows[2].name, "G2");
  EXPECT_EQ(std::get<Measured>(table.rows[2].cells[0]).value, 3);
  EXPECT_EQ(std::get<Measured>(table.rows[2].cells[0]).standard_error, .3);
  EXPECT_TRUE(std::isnan(std::get<Measured>(table.rows[1].cells[1]).value));
}

TEST(GaussianEllipse, HasTheMahalanobisDistanceEverywhere) {
  const double vx = 4, vy = 9, cov = -3;
  const PointSeries curve = gaussian_ellipse("e", 1, 2, vx, vy, cov, 2);
  const double determinant = vx * vy - cov * cov;
  for (std::size_t i = 0; i < curve.x.size(); ++i) {
    const double x = curve.x[i] - 1, y = curve.y[i] - 2;
    EXPECT_NEAR((vy * x * x - 2 * cov * x * y + vx * y * y) / determinant, 4, 1e-9);
  }
  EXPECT_NEAR(curve.x.front(), curve.x.back(), 1e-12);
}

Chart box_chart(double largest = 100) {
  BoxSeries boxes{"b", {"R"}, {{1, 2, 3, 4, largest}}};
  return {
      "Boxes", "five values", {"channel", "1", AxisScale::kCategory, {"R"}}, {"v", "DN"}, {boxes}};
}

TEST(BoxPlot, WhiskersEndAtOneAndAHalfQuartileRanges) {
  // Quartiles 2 and 4 (definition 7), so values beyond 4 + 3 stand alone.
  const std::string html = report_html(report_of(ChartsBlock{"", {{"", box_chart()}}}));
  EXPECT_THAT(html, HasSubstr(R"("boxes":[[1.0,2.0,3.0,4.0,4.0]])"));
  EXPECT_THAT(html, HasSubstr(R"("outliers":[{"category":0,"value":100.0}])"));
  const auto boxes_of = [](double largest) {
    return report_html(report_of(ChartsBlock{"", {{"", box_chart(largest)}}}));
  };
  EXPECT_THAT(boxes_of(6.75), HasSubstr(R"("boxes":[[1.0,2.0,3.0,4.0,6.75]])"));
  EXPECT_THAT(boxes_of(7.25), HasSubstr(R"("boxes":[[1.0,2.0,3.0,4.0,4.0]])"));
}

std::string text_of(const std::filesystem::path& path) {
  std::ostringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

TEST(WriteFigures, OneSvgPerVariantWithSafeNames) {
  const testing::TemporaryFolder folder;
  Chart chart = box_chart();
  chart.title = "../<Boxes> & more";
  const auto written = write_figures(
      report_of(ChartsBlock{"Gain", {{"0 dB", chart}, {"24 dB", chart}}}), folder.path(), false);
  ASSERT_EQ(written.size(), 2U);
  for (const auto& path : written) EXPECT_EQ(path.parent_path(), folder.path());
  EXPECT_NE(written[0], written[1]);
  EXPECT_THAT(text_of(written[0]), HasSubstr("<title>../&lt;Boxes&gt; &amp; more</title>"));
}

TEST(WriteFigures, NamesSpellLettersAndSayTheGainOnce) {
  const testing::TemporaryFolder folder;
  Chart low = box_chart(), high = box_chart();
  low.title = "Correlation of μ between channels at 0 dB";
  high.title = "Correlation of σ_b and λ, χ² at 24 dB";
  const auto written = write_figures(
      report_of(ChartsBlock{"Gain", {{"0 dB", low}, {"24 dB", high}}}), folder.path(), false);
  ASSERT_EQ(written.size(), 2U);
  EXPECT_THAT(written[0].filename().string(),
              EndsWith("Correlation_of_mu_between_channels_at_0_dB.svg"));
  EXPECT_THAT(written[1].filename().string(),
              EndsWith("Correlation_of_sigma_b_and_lambda_chi2_at_24_dB.svg"));
}

TEST(WriteFigures, BarsStandOnZero) {
  const testing::TemporaryFolder folder;
  PointSeries bars{.name = "dB", .mark = Mark::kBars};
  bars.x = {0, 1};
  bars.y = {10, -5};
  const Chart chart{"Bars", "", {"p", "1", AxisScale::kCategory, {"a", "b"}}, {"dB"}, {bars}};
  const auto written =
      write_figures(report_of(ChartsBlock{"", {{"", chart}}}), folder.path(), false);
  const std::string svg = text_of(written.at(0));
  const std::size_t at = svg.find("fill-opacity=\"0.55\"");
  ASSERT_NE(at, std::string::npos);
  const std::string path = svg.substr(svg.rfind("d=\"", at));
  double x[2], top[2], width[2], base[2];
  ASSERT_EQ(std::sscanf(path.c_str(), "d=\"M%lf %lfh%lfV%lfh-%*fzM%lf %lfh%lfV%lf", x, top, width,
                        base, x + 1, top + 1, width + 1, base + 1),
            8);
  EXPECT_DOUBLE_EQ(base[0], base[1]);
  EXPECT_NEAR(base[0] - top[0], 2 * (top[1] - base[1]), 0.2);  // y goes down
}

TEST(WriteFigures, PointsLieWhereTheAxesSay) {
  const testing::TemporaryFolder folder;
  PointSeries line{.name = "l", .mark = Mark::kLine};
  line.x = {1, 10, 100};
  line.y = {0, 5, 10};
  Chart chart{"Line", "", {"x", "1", AxisScale::kLogarithmic}, {"y"}, {line}};
  const auto written =
      write_figures(report_of(ChartsBlock{"", {{"", chart}}}), folder.path(), false);
  const std::string svg = text_of(written.at(0));
  const std::size_t at = svg.find("stroke=\"#0072b2\"");
  ASSERT_NE(at, std::string::npos);
  double x[3], y[3];
  const std::string path = svg.substr(svg.rfind("d=\"", at));
  ASSERT_EQ(
      std::sscanf(path.c_str(), "d=\"M%lf %lfL%lf %lfL%lf %lf", x, y, x + 1, y + 1, x + 2, y + 2),
      6);
  EXPECT_NEAR(x[1] - x[0], x[2] - x[1], 0.2);  // decades are as wide as each other
  EXPECT_NEAR(y[0] - y[1], y[1] - y[2], 0.2);
  EXPECT_GT(y[0], y[2]);  // up is more
}

// Texts of the ticks on the y axis, the only texts that end at the axis.
std::vector<std::string> y_labels(const std::string& svg) {
  static const std::regex kLabel(R"x(text-anchor="end">([^<]*)</text>)x");
  std::vector<std::string> labels;
  for (std::sregex_iterator at(svg.begin(), svg.end(), kLabel), end; at != end; ++at)
    labels.push_back((*at)[1]);
  return labels;
}

TEST(WriteFigures, ValuesThatDifferByRoundingAloneHaveAFewTicks) {
  for (const double value : {0.3, 1.0, -1e-9, 1e9, 1e20, 1e300}) {
    PointSeries line{.name = "l", .mark = Mark::kLine};
    line.x = {1, 2, 3};
    line.y = {std::nextafter(value, HUGE_VAL), value, value};
    const std::string svg = chart_svg({"Line", "", {"x"}, {"y"}, {line}});
    EXPECT_GE(y_labels(svg).size(), 1U) << value;
    EXPECT_LE(y_labels(svg).size(), 10U) << value;
    EXPECT_THAT(svg, Not(HasSubstr("nan"))) << value;
  }
}

TEST(WriteFigures, PointsOfUnknownErrorCountForTheAxis) {
  PointSeries points{.name = "p"};
  points.x = {1, 2, 3};
  points.y = {500, 700, 900};
  points.error = {NAN, 10, NAN};
  const auto labels = y_labels(chart_svg({"Points", "", {"x"}, {"y"}, {points}}));
  EXPECT_THAT(labels, ::testing::IsSupersetOf({"500", "700", "900"}));
}

// σ_b of a camera without row noise is 0 within its error: the bar ends where the axis does.
TEST(WriteFigures, ErrorBarsThatReachBelowALogarithmicAxisEndThere) {
  PointSeries points{.name = "p"};
  points.x = {1, 2, 3};
  points.y = {0.0136, 0.05, 0};
  points.error = {0.0205, 0.01, 0.02};
  const std::string svg =
      chart_svg({"Points", "", {"x"}, {"y", "1", AxisScale::kLogarithmic}, {points}});
  const std::size_t at = svg.find("fill=\"none\" stroke=\"#0072b2\"");
  ASSERT_NE(at, std::string::npos);
  double x[2], from[2], to[2];
  ASSERT_EQ(std::sscanf(svg.substr(svg.rfind("d=\"", at)).c_str(), "d=\"M%lf %lfV%lfM%lf %lfV%lf",
                        x, from, to, x + 1, from + 1, to + 1),
            6);
  EXPECT_GT(from[0], from[1]);  // down to the axis
  EXPECT_DOUBLE_EQ(from[0], 460 - 62);
  EXPECT_THAT(svg, Not(HasSubstr("nan")));
  EXPECT_THAT(svg, Not(HasSubstr("inf")));
}

TEST(WriteFigures, PointsThatNoLineReachesAreDots) {
  const PointSeries line{
      .name = "l", .mark = Mark::kLine, .x = {1, 2, 3, 4, 5}, .y = {1, 2, NAN, 2, NAN}};
  const std::string svg = chart_svg({"Line", "", {"x"}, {"y"}, {line}});
  const auto dots = [](const std::string& text) {
    static const std::regex kDot(R"(a2\.2 2\.2 0 1 0 4\.4 0)");
    return std::distance(std::sregex_iterator(text.begin(), text.end(), kDot), {});
  };
  EXPECT_EQ(dots(svg), 1);
  const PointSeries lone{.name = "l", .mark = Mark::kLine, .x = {3}, .y = {0.5}};
  EXPECT_EQ(dots(chart_svg({"Line", "", {"x"}, {"y"}, {lone}})), 1);
}

std::vector<std::string> key_labels(const std::string& svg) {
  static const std::regex kLabel(
      R"x(<text x="620\.0"[^>]*text-anchor="start"[^>]*>([^<]*)</text>)x");
  std::vector<std::string> labels;
  for (std::sregex_iterator at(svg.begin(), svg.end(), kLabel), end; at != end; ++at)
    labels.push_back((*at)[1]);
  return labels;
}

// Sixteen channels with their fits and what was left out: fifty entries were cut off at twenty.
TEST(WriteFigures, TheKeyHasEveryChannelWithItsSymbolAndExplainsLinesOnce) {
  Chart chart{"Transfer", "", {"x"}, {"y"}, {}};
  std::vector<std::string> names;
  for (const char* filter : {"R", "G1_", "G2_", "B"})
    for (const char* angle : {"90", "45", "135", "0"}) {
      names.push_back(std::string(filter) + angle);
      PointSeries points{.name = names.back(),
                         .mark = Mark::kPoints,
                         .tone = names.back(),
                         .x = {1, 2},
                         .y = {1, 2}};
      chart.series.emplace_back(points);
      points.name += ", fit";
      points.mark = Mark::kLine;
      chart.series.emplace_back(points);
      points.name = names.back() + ", left out";
      points.mark = Mark::kCrosses;
      chart.series.emplace_back(points);
    }
  names.insert(names.end(), {"fit", "left out"});
  const std::string svg = chart_svg(chart);
  EXPECT_EQ(key_labels(svg), names);
  EXPECT_THAT(svg, Not(HasSubstr("<rect x=\"6")));  // no square stands for a circle or a line
  // A key that cannot hold all says how many it left out.
  chart.series.clear();
  for (int i = 0; i < 100; ++i)
    chart.series.emplace_back(PointSeries{
        .name = "run " + std::to_string(i), .mark = Mark::kLine, .x = {1, 2}, .y = {1, 2}});
  const auto many = key_labels(chart_svg(chart));
  EXPECT_GT(many.size(), 30U);
  EXPECT_EQ(many.back(), "and " + std::to_string(101 - many.size()) + " more");
}

Report three_charts() {
  Chart first = box_chart(), second = box_chart();
  first.text = "first";
  second.text = "second";
  Report report = report_of(ChartsBlock{"", {{"", first}}});
  report.sections[0].blocks.emplace_back(ChartsBlock{"", {{"", second}}});
  second.title = "Boxes 2";
  report.sections[0].blocks.emplace_back(ChartsBlock{"", {{"", second}}});
  return report;
}

TEST(WriteFigures, ChartsOfTheSameNameAreNumbered) {
  const testing::TemporaryFolder folder;
  const auto written = write_figures(three_charts(), folder.path(), false);
  EXPECT_THAT(written, ::testing::ElementsAre(folder / "one_Boxes.svg", folder / "one_Boxes_2.svg",
                                              folder / "one_Boxes_2_2.svg"));
  EXPECT_THAT(text_of(written[0]), HasSubstr("<desc>first</desc>"));
  EXPECT_THAT(text_of(written[1]), HasSubstr("<desc>second</desc>"));
}

TEST(WriteFigures, NothingIsWrittenWhereOneFileExists) {
  const testing::TemporaryFolder folder;
  std::ofstream(folder / "one_Boxes_2.svg") << "mine";
  EXPECT_THROW(write_figures(three_charts(), folder.path(), false), InputError);
  EXPECT_FALSE(std::filesystem::exists(folder / "one_Boxes.svg"));
  EXPECT_EQ(text_of(folder / "one_Boxes_2.svg"), "mine");
}

TEST(WriteFigures, NamesKeepTheSignOfAGain) {
  const testing::TemporaryFolder folder;
  Chart low = box_chart(), high = box_chart();
  low.title = "Bias at -3 dB";
  high.title = "Bias at 3 dB, 0-1 DN";
  const auto written = write_figures(
      report_of(ChartsBlock{"Gain", {{"-3 dB", low}, {"3 dB", high}}}), folder.path(), false);
  EXPECT_THAT(written, ::testing::ElementsAre(folder / "one_Bias_at_minus3_dB.svg",
                                              folder / "one_Bias_at_3_dB_0_1_DN.svg"));
}

}  // namespace
}  // namespace malus
