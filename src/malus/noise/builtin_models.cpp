#include "malus/noise/builtin_models.h"

#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/base/wording.h"
#include "malus/noise/internal/published_cameras.h"
#include "malus/noise/physics.h"
#include "malus/noise/tukey_lambda.h"

#include <cmath>

namespace malus {
namespace {

using Values = std::vector<double>;

// Rows, quantisation and all.
void set_dark_deviation(PhysicsCalibration& p, double quantization_dn) {
  for (std::size_t c = 0; c < p.sigma_tl.mean.size(); ++c) {
    const PhysicsChannel channel{.lambda = p.lambda.mean[c],
                                 .sigma_tl_dn = p.sigma_tl.mean[c],
                                 .sigma_row_dn = p.sigma_row.mean[c]};
    p.temporal_sd_dark_dn.push_back(dark_deviation_dn(channel, quantization_dn));
  }
}

void add_joint_model(NoiseModel& model) {
  if (auto joint = fit_joint_model(model.physics)) model.joint = joint.value();
}

// --- IMX250MYR and MZR: invented to be plausible
// -----------------------------------------------------

constexpr double kFullWellE = 10500;  // published full well of the IMX250 at 0 dB
constexpr double kReadE = 2.3;        // published read noise; grows towards low gain
constexpr double kAdcReadDn = 0.35;   // noise behind the amplifier
constexpr double kRowE = 0.22, kRowDn = 0.05;
constexpr int kRowPairColors = 2;  // colours that share a row group: R with G1, G2 with B

bool share_rows(const SensorLayout& layout, int a, int b) {
  return a / (kRowPairColors * layout.cols()) == b / (kRowPairColors * layout.cols());
}

// 000 Fig. 4: R-G1 and G2-B highly correlated, the others nearly not.
SquareMatrix row_pair_correlation(const SensorLayout& layout, double inside) {
  SquareMatrix r = SquareMatrix::identity(layout.channels());
  for (int i = 0; i < r.n; ++i)
    for (int j = 0; j < r.n; ++j)
      if (i != j) r(i, j) = share_rows(layout, i, j) ? inside : 0.04;
  return r;
}

// A small fixed difference of every channel, between -1 and 1, without a pattern that repeats.
double channel_offset(int channel, double phase) { return std::sin(2.4 * channel + phase); }

PhysicsCalibration simulated_gain(const SensorLayout& layout, double gain_db) {
  PhysicsCalibration p;
  p.gain.gain_db = gain_db;
  const double K0 = (4095.0 - 82.0) / kFullWellE;
  const double amplification = std::pow(10.0, gain_db / 20.0);
  Values mu_sd, row_sd;
  for (int c = 0; c < layout.channels(); ++c) {
    const double K = K0 * amplification * (1.0 + 0.004 * channel_offset(c, 0.3));
    const double read_dn =
        std::hypot(K * kReadE * (1.0 + 0.02 * channel_offset(c, 1.1)), kAdcReadDn);
    const double lambda = 0.13 - 0.0025 * gain_db + 0.004 * channel_offset(c, 2.0);
    p.K.mean.push_back(K);
    p.lambda.mean.push_back(lambda);
    p.lambda.spread.push_back(0.004);
    p.sigma_tl.mean.push_back(read_dn / tukey_lambda_deviation(1.0, lambda));
    p.sigma_tl.spread.push_back(0.004 * p.sigma_tl.mean.back());
    p.sigma_row.mean.push_back(
        std::hypot(K * kRowE * (1.0 + 0.05 * channel_offset(c, 0.7)), kRowDn));
    row_sd.push_back(0.04 * p.sigma_row.mean.back());
    // The bias falls faster than the gain rises (000, 3.2).
    p.mu.mean.push_back(-0.55 * std::pow(K, 1.25) * (1.0 + 0.06 * channel_offset(c, 1.7)));
    mu_sd.push_back(0.01 + 0.03 * K);
  }
  p.mu.spread = mu_sd;
  p.mu.covariance = covariance_of(row_pair_correlation(layout, 0.92), mu_sd);
  p.sigma_row.spread = row_sd;
  p.sigma_row.covariance = covariance_of(row_pair_correlation(layout, 0.88), row_sd);
  set_dark_deviation(p, 1.0);
  return p;
}

NoiseModel make_imx250(const char* sensor, const char* layout) {
  NoiseModel model;
  model.sensor = sensor;
  model.layout = SensorLayout::named(layout);
  model.black_dn.assign(static_cast<std::size_t>(model.layout.channels()), 82.0);
  model.white_dn = 4095;
  model.row_group = 2;
  model.row_group_origin = "declared";
  model.origin =
      "SIMULATED: invented to be plausible, measured on no camera. 12 bit, full well 10500 e- and "
      "read noise 2.3 e- as published for the IMX250; the rest chosen after the figures of "
      "'Polarized Color Image Denoising'. Calibrate your own camera for real work";
  for (double gain_db : {0.0, 6.0, 12.0, 18.0, 24.0, 30.0})
    model.physics.push_back(simulated_gain(model.layout, gain_db));
  add_joint_model(model);
  return model;
}

NoiseModel make_imx250myr() {
  return make_imx250("Sony IMX250MYR (simulated)", "polar-bayer-rggb");
}
NoiseModel make_imx250mzr() { return make_imx250("Sony IMX250MZR (simulated)", "polar-mono"); }

// --- Published calibrations ------------------------------------------------------------------

NoiseModel published_model(const std::string& sensor, double black_dn, const std::string& origin) {
  NoiseModel model;
  model.sensor = sensor;
  model.layout = SensorLayout::named("bayer-rggb");
  model.black_dn.assign(4, black_dn);
  model.white_dn = 16383;
  model.origin = origin;
  return model;
}

NoiseModel make_sony_a7s2() {
  NoiseModel model = published_model(
      "Sony A7S II", 512,
      "published calibration, megvii-research/PMN (Apache-2.0); one value for all channels; 14 bit "
      "DN above black; mean bias not published, taken as 0");
  for (const internal::PublishedGain& g : internal::sony_a7s2_gains()) {
    PhysicsCalibration p;
    p.gain.iso = g.iso;
    p.K.mean.assign(4, g.K);
    p.lambda.mean.assign(4, g.lambda);
    p.mu.mean.assign(4, 0.0);
    p.mu.spread.assign(4, g.bias_sd_dn);
    p.sigma_tl.mean.assign(4, g.sigma_tl_dn);
    p.sigma_tl.spread.assign(4, g.sigma_tl_sd_dn);
    p.sigma_row.mean.assign(4, g.sigma_row_dn);
    p.sigma_row.spread.assign(4, g.sigma_row_sd_dn);
    set_dark_deviation(p, 1.0);
    model.physics.push_back(p);
  }
  add_joint_model(model);
  return model;
}

// The source gives laws over K between Kmin and Kmax = 64 Kmin, without ISO numbers. Kmin is taken
// as ISO 100: the Sony's Kmin agrees with the other publication's K at ISO 100 to 2 %.
NoiseModel make_eld(const internal::PublishedCamera& camera) {
  NoiseModel model = published_model(
      camera.sensor, 800,
      "published log-linear laws, Vandermode/ELD (MIT), Profile-1; 14 bit DN above black; ISO "
      "inferred (Kmin = ISO 100), black 800 as in the source's code, lambda the median of its "
      "samples");
  for (double iso = 100; iso <= 6400; iso *= 2) {
    const double K = camera.K_min * iso / 100.0;
    const auto law = [&](const internal::PublishedLaw& l) {
      return std::exp(l.slope * std::log(K) + l.bias);
    };
    PhysicsCalibration p;
    p.gain.iso = iso;
    p.K.mean.assign(4, K);
    p.lambda.mean.assign(4, camera.lambda);
    p.mu.mean.assign(camera.bias_dn.begin(), camera.bias_dn.end());
    p.mu.covariance = SquareMatrix(4);
    p.mu.covariance.values.assign(camera.bias_covariance_dn2.begin(),
                                  camera.bias_covariance_dn2.end());
    p.sigma_tl.mean.assign(4, law(camera.sigma_tl));
    p.sigma_tl.spread.assign(4, camera.sigma_tl.sigma * law(camera.sigma_tl));
    p.sigma_row.mean.assign(4, law(camera.sigma_row));
    p.sigma_row.spread.assign(4, camera.sigma_row.sigma * law(camera.sigma_row));
    set_dark_deviation(p, 1.0);
    model.physics.push_back(p);
  }
  add_joint_model(model);
  return model;
}

template <std::size_t kIndex>
NoiseModel make_eld_number() {
  return make_eld(internal::eld_cameras().at(kIndex));
}

}  // namespace

const std::vector<BuiltinModel>& builtin_models() {
  static const std::vector<BuiltinModel> models = {
      {"imx250myr-simulated",
       "colour-polarization sensor IMX250MYR, 0-30 dB; simulated, not measured", "Apache-2.0",
       make_imx250myr},
      {"imx250mzr-simulated",
       "mono-polarization sensor IMX250MZR, 0-30 dB; simulated, not measured", "Apache-2.0",
       make_imx250mzr},
      {"sony-a7s2", "Sony A7S II, ISO 50-25600, two conversion gains; PMN's calibration",
       "Apache-2.0", make_sony_a7s2},
      {"canon-5d4", "Canon EOS 5D Mark IV, ISO 100-6400; ELD's laws", "MIT", make_eld_number<0>},
      {"canon-700d", "Canon EOS 700D, ISO 100-6400; ELD's laws", "MIT", make_eld_number<1>},
      {"canon-70d", "Canon EOS 70D, ISO 100-6400; ELD's laws", "MIT", make_eld_number<2>},
      {"nikon-d850", "Nikon D850, ISO 100-6400; ELD's laws", "MIT", make_eld_number<3>},
      {"sony-a7s2-eld", "Sony A7S II, ISO 100-6400; ELD's laws", "MIT", make_eld_number<4>},
  };
  return models;
}

std::optional<NoiseModel> builtin_model_for(const std::filesystem::path& path) {
  constexpr std::string_view kPrefix = "builtin:";
  std::string name = path.string();
  const bool prefixed = name.starts_with(kPrefix);
  std::error_code error;
  if (prefixed)
    name.erase(0, kPrefix.size());
  else if (std::filesystem::exists(path, error))
    return std::nullopt;
  for (const BuiltinModel& model : builtin_models())
    if (model.name == name) return model.make();
  if (!prefixed) return std::nullopt;
  const std::string nearest = nearest_name(name, builtin_model_names());
  throw InputError(path.string(), "is no built-in noise model",
                   (nearest.empty() ? "" : "did you mean builtin:" + nearest + "? ") +
                       command("model list") + " shows all");
}

std::vector<std::string> builtin_model_names() {
  std::vector<std::string> names;
  for (const BuiltinModel& model : builtin_models()) names.push_back(model.name);
  return names;
}

}  // namespace malus
