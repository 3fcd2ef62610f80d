// A network with everything that is needed to use it on a frame: what goes in, what comes out, in
// which domain, and how it was trained. Stored in the metadata of a weight file, checked when read.
// Training and inference carry frames into the network's domain and back through this header alone.
#pragma once

#include "malus/base/parameter.h"
#include "malus/denoise/cut_off.h"
#include "malus/denoise/denoise_profile.h"
#include "malus/denoise/prepared_frame.h"
#include "malus/image/window.h"
#include "malus/neural/network.h"
#include "malus/neural/network_target.h"

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace malus {

/// What a network takes and gives, apart from its layers.
struct PackageSettings {
  std::string layout = "polar-bayer-rggb", domain = "stabilised", noise_input = "level",
              guide = "none", guide_profile = "normal", amplification = "auto", target = "mosaic";
  bool residual = true, row_noise = true, remove_bias = true;

  template <class Self, class Visitor>
  static void describe(Self& self, Visitor&& field) {
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    const auto choice = [&](auto& value, const char* name, const char* help,
                            std::vector<std::string> choices) {
      field(value, ParameterInfo{name, "", help, -kInfinity, kInfinity, std::move(choices)});
    };
    field(self.layout,
          ParameterInfo{"layout", "", "sensor layout; one plane per site of its cell"});
    choice(self.domain, "domain",
           "stabilised: planes of unit noise, divided by the frame's scale; linear: light above "
           "black, divided by white and amplified (000, 5.1)",
           {"stabilised", "linear"});
    choice(self.noise_input, "noise_input",
           "level: the noise deviation as further input, one plane where it is the same "
           "everywhere (stabilised), else one per channel; units: also, the network works in units "
           "of it",
           {"level", "units", "none"});
    choice(self.guide, "guide",
           "a classical method whose result goes in as further planes; a residual network then "
           "corrects it",
           {"none", "bm3d", "nl-ridge"});
    choice(self.guide_profile, "guide_profile", "profile of the guide", denoise_profile_names());
    choice(self.amplification, "amplification",
           "linear domain: by the low-light ratio, which the caller knows, or so that the mean "
           "becomes 0.18",
           {"auto", "ratio"});
    choice(
        self.target, "target",
        "mosaic: the denoised planes; of a Bayer sensor also a picture of the mosaic's size, rgb: "
        "linear light (joint denoising and demosaicking: 001, S4), srgb: as displayed, exposed "
        "as the network's input is (neural ISP: 001, S6.1)",
        {kNetworkTargetNames.begin(), kNetworkTargetNames.end()});
    field(self.residual, ParameterInfo{"residual", "",
                                       "the network's output is added to the guide, or to the "
                                       "noisy planes where there is none; not for pictures"});
    field(self.row_noise,
          ParameterInfo{"row_noise", "", "row noise is estimated and removed before the network"});
    field(self.remove_bias, ParameterInfo{"remove_bias", "",
                                          "the model's mean bias of every channel is subtracted "
                                          "before the network (000, 5.1, and debias: the mean "
                                          "over the channels, off all of them)"});
  }

  NetworkTarget gives() const { return network_target(target); }
  /// Where in the layout's cell that of a sensor begins which the network serves: of this layout,
  /// of another Bayer order, or without colours (SensorLayout::phase_in), but no picture comes of
  /// the latter. None of other sensors.
  std::optional<CellPhase> phase_of(const SensorLayout& sensor) const;
};

struct NetworkPackage {
  NetworkDescription network;
  PackageSettings settings;
  nlohmann::json training;  ///< record: data, steps, seed, models, date, figures; may be null
  /// The brightest light of training, in deviations of the noise (trained_light.h); infinite where
  /// it is not known.
  double brightest = std::numeric_limits<double>::infinity();

  SensorLayout layout() const { return SensorLayout::named(settings.layout); }
  int planes() const { return layout().channels(); }  ///< P: of the noisy mosaic
  bool gives_picture() const { return settings.gives() != NetworkTarget::kMosaic; }
  /// What the network gives: P, or red, green and blue of a picture.
  int output_planes() const { return gives_picture() ? 3 : planes(); }
  /// Rows (and columns) of what the network gives per row of its input planes.
  int upscale() const { return gives_picture() ? 2 : 1; }
  /// P of the guide if any, P noisy, then the noise planes: the base of a residual comes first.
  int input_planes() const;
  /// The output is the guide's result and a correction of it.
  bool corrects_guide() const { return settings.residual && settings.guide != "none"; }
};

/// Settings of the architecture that make its channels fit the package: input_planes() in,
/// output_planes() out at upscale() times the size; architectures with as many out as in give
/// further planes, which are left out. Throws InputError on settings that do not fit together:
/// pictures come from Bayer mosaics by unet, in the linear domain, neither as a residual nor in
/// units of the noise.
NetworkDescription fitted_network(NetworkDescription network, const PackageSettings& settings);

/// Metadata of a weight file and back. Throws InputError, naming source, on metadata that is
/// missing, unknown or does not fit together. A package without "target" is of the time when all
/// gave mosaics.
TensorFile package_file(const NetworkPackage& package, const Network& network);
NetworkPackage package_of(const TensorFile& file, const std::string& source);

/// Network and settings, as a configuration has them: packages of the same take and give the same.
nlohmann::json package_json(const NetworkPackage& package);

struct LoadedPackage {
  NetworkPackage package;
  std::shared_ptr<Network> network;  ///< in eval mode
};
/// Throws InputError, naming source, where a weight is not finite.
void check_finite(const TensorFile& file, const std::string& source);

/// Reads, builds and fills; also refuses weights that are not finite. Throws InputError.
LoadedPackage load_package(const std::filesystem::path& path);

/// Carries one frame into the network's domain and back: measured once for the whole frame, so
/// that tiles agree. Planes are [1, channel, row, column] of the layout's packed size.
///   stabilised: plane = stabilised sample / s, s = 4 + 3 * mean of the positive samples
///   linear:     plane = DN above black and bias / s, s = (white - black) / amplification
/// Planes are in the package's order. A frame of another Bayer order is one of the package's layout
/// that begins inside a cell, and one without colours sees grey light (PackageSettings::phase_of).
class FrameDomain {
 public:
  /// ratio: for amplification "ratio". Contract: settings.phase_of(the frame's layout).
  FrameDomain(const PackageSettings& settings, const PreparedFrame& frame,
              const NoiseProfile& profile, std::optional<double> ratio = {});

  double scale() const { return scale_; }
  const SensorLayout& layout() const { return layout_; }  ///< the package's
  /// Of the frame's pixel (row, col) in the cell of layout().
  CellPhase phase_at(int row, int col) const;
  /// Noisy samples, in DN above black and bias: the whole frame, or the part of it that begins at
  /// `first`, a phase_at().
  torch::Tensor noisy_planes(View<const float> dn, std::optional<CellPhase> first = {}) const;
  /// A noise-free signal: guide and target. Its planes are the means that noisy_planes has.
  torch::Tensor clean_planes(View<const float> dn, std::optional<CellPhase> first = {}) const;
  /// [1, 1 or P, rows, cols], or none ([1, 0, rows, cols]); above 0.
  torch::Tensor noise_planes(View<const float> noisy_dn, std::optional<CellPhase> first = {}) const;
  /// How far light at a pixel of the frame [DN above black and bias] lies above the code that noise
  /// is cut off at, in deviations of the dark noise; infinite where nothing is.
  double above_cut_off(int row, int col, double dn) const;
  /// The network's planes back to DN, by the exact unbiased inverse: clean_planes' inverse.
  Image mosaic_of(const torch::Tensor& planes, int rows, int cols,
                  std::optional<CellPhase> first = {}) const;

 private:
  template <class Map>
  torch::Tensor mapped(View<const float> dn, CellPhase first, const Map& map) const;

  SensorLayout layout_;
  CellPhase phase_;  ///< of the frame's first pixel
  bool stabilised_, noise_level_;
  double least_deviation_dn_;  ///< of the noise planes, as the Stabilizer's
  double scale_ = 1;
  std::vector<Stabilizer> stabilizers_;  ///< empty in the linear domain
  std::vector<std::optional<NoiseLaw>> laws_;
  std::vector<VarianceCurve> variances_;
};

/// A frame made ready for a network.
struct NetworkFrame {
  PreparedFrame frame;
  Image guide_dn;  ///< empty without a guide
  FrameDomain domain;
  CutOff cut_off;
  Denoised report;  ///< facts about the input; guide's tiles, times and stated variance
};

/// What a prepared frame's report holds beside facts about the input.
struct WantedReport {
  bool noise_check = true;  ///< the profile's noise against the frame's
  bool variance = false;    ///< the guide's stated error. Contract: there is a guide
};

/// Prepares a frame as the classical method does, noise that the camera cut off at 0 among the rest
/// where the domain is stabilised, and runs the guide where the package wants one
/// (classical: profile and memory; its method and row_noise are not used). Throws InputError as
/// denoise_frame, on another sensor's layout than the package's, and where a needed ratio is not
/// given.
NetworkFrame prepare_network_frame(RawFrame frame, const NoiseProfile& profile,
                                   const PackageSettings& settings,
                                   const DenoiseSettings& classical = {},
                                   std::optional<double> ratio = {},
                                   Progress& progress = silent_progress(),
                                   WantedReport wanted_report = {});

/// [1, input_planes, rows, cols] of a window of the frame.
torch::Tensor prepare_input(const NetworkFrame& frame, const MosaicWindow& window);

/// [batch, 1 or planes, rows, cols]: the noise planes of an input; ones where it has none.
torch::Tensor noise_level_of(const NetworkPackage& package, const torch::Tensor& input);

/// [batch, output_planes, rows, cols]: the network's forward pass and, for a residual, the base
/// added. A guide brighter than the light of training is corrected by less, or not at all
/// (trained_light.h).
/// In units of the noise deviation σ (noise_input "units") the network sees base / 8σ, with a guide
/// (noisy - guide) / σ, and σ; its correction is multiplied by σ.
torch::Tensor apply_network(Network& network, const NetworkPackage& package,
                            const torch::Tensor& input);

/// Light of red, green and blue in DN above black and bias, [3] of the frame's size, as a network's
/// target: [1, 3, rows, cols], divided by the domain's scale; for "srgb" held to 0..1 and put
/// through sRGB's curve.
torch::Tensor picture_target(const PackageSettings& settings, const FrameDomain& domain,
                             const Planes& rgb_dn);

/// The network's picture cut to the frame's size: DN above black and bias for "rgb", displayed
/// values of about 0..1 for "srgb".
Planes picture_of(const PackageSettings& settings, const FrameDomain& domain,
                  const torch::Tensor& planes, int rows, int cols);

/// The network's planes of a window as a mosaic in DN above black and bias; saturated pixels come
/// back as they are.
Image restore_output(const NetworkFrame& frame, const torch::Tensor& planes,
                     const MosaicWindow& window);

/// What is done to the whole frame's restored mosaic after: a correction of a guide whose stated
/// error the report holds is held to it (correction_limit.h), and places that show no noise stay at
/// 0 (keep_voids).
void finish_output(const NetworkFrame& frame, Image& mosaic_dn);

}  // namespace malus
