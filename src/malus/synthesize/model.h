// The short way from a model file to noise in an array: what most users of the library call first.
//
//   const auto model = malus::Model::load("imx250myr.h5");
//   model.at_gain(24).synthesize(clean, noisy, seed, frame);
#pragma once

#include "malus/synthesize/synthesizer.h"

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

namespace malus {

/// Draws noise at one gain (or at random gains). Cheap to copy; safe to use from several threads.
class NoiseAtGain {
 public:
  /// clean_dn: mosaic in DN above black; noisy_dn: the same, nothing rounded or clamped; may be
  /// clean_dn. The same seed, frame and pixel give the same noise for any thread count, machine and
  /// crop (row0, col0: the view's place in the frame). Throws InputError on unequal sizes. Returned
  /// is what a non-parametric model was not calibrated for; empty of other kinds.
  LevelCoverage synthesize(View<const float> clean_dn, View<float> noisy_dn, std::uint64_t seed,
                           std::uint32_t frame = 0, int row0 = 0, int col0 = 0) const;
  /// Packed planes in the layout's channel order, [channel, row, column]; equal to packing what
  /// synthesize gives.
  LevelCoverage synthesize_packed(const std::vector<View<const float>>& clean_dn,
                                  const std::vector<View<float>>& noisy_dn, std::uint64_t seed,
                                  std::uint32_t frame = 0) const;

  /// The same mosaic as the camera would write it, whole codes with black (Synthesizer::draw_raw),
  /// at the model's black and white, or at the white of 16 bits where it tells none. drawn, if
  /// given, gets what the frame was drawn with.
  RawFrame synthesize_raw(View<const float> clean_dn, std::uint64_t seed, std::uint32_t frame = 0,
                          int row0 = 0, int col0 = 0, FrameParameters* drawn = nullptr) const;

  /// Throws InputError unless both are one plane of one size per channel.
  void require_planes(const std::vector<View<const float>>& clean_dn,
                      const std::vector<View<float>>& noisy_dn) const;
  const NoiseModel& model() const { return synthesizer_->model(); }
  const SynthesisSettings& settings() const { return synthesizer_->settings(); }

  /// The same settings at another gain, as Model::at_gain (empty: random, as at_random_gain).
  NoiseAtGain with_gain(const std::optional<double>& gain) const;
  /// "physics at 24 dB", "gaussian at random gains".
  std::string text() const;

 private:
  friend class Model;
  NoiseAtGain(std::shared_ptr<const Synthesizer> synthesizer, std::optional<GainSetting> gain)
      : synthesizer_(std::move(synthesizer)), gain_(gain) {}
  std::shared_ptr<const Synthesizer> synthesizer_;
  std::optional<GainSetting> gain_;
};

/// Holds its description once: copies, and all noise drawn of it, share it.
class Model {
 public:
  /// A model file, or a built-in model by name. Throws InputError.
  static Model load(const std::filesystem::path& path);
  explicit Model(NoiseModel description);

  /// gain in the unit that the model was measured in: dB, or ISO. Throws InputError outside the
  /// calibrated range, and of kind dark-frames at a gain without them.
  NoiseAtGain at_gain(double gain, const SynthesisSettings& settings = {}) const;
  /// Every frame draws its own gain (000, 5.1).
  NoiseAtGain at_random_gain(const SynthesisSettings& settings = {}) const;

  /// NoiseModel::setting_of.
  GainSetting gain_setting(double gain) const;
  const NoiseModel& description() const { return *description_; }
  /// The same, for a Synthesizer that shall share it.
  const std::shared_ptr<const NoiseModel>& shared_description() const { return description_; }

 private:
  std::shared_ptr<const NoiseModel> description_;
};

}  // namespace malus
