#include "noise_stand_in.h"

#include <memory>
#include <utility>

#include "frame_input.h"
#include "networks_door.h"

namespace malus::app {
namespace {

NoiseModel sensor_levels(SensorLayout layout, std::vector<double> black_dn, double white_dn) {
  NoiseModel levels;
  levels.layout = std::move(layout);
  levels.black_dn = std::move(black_dn);
  levels.white_dn = white_dn;
  return levels;
}

}  // namespace

StandIn calibrated_stand_in(std::shared_ptr<const NoiseModel> model,
                            const std::filesystem::path& file, const SynthesisSettings& settings) {
  const auto synthesizer = std::make_shared<const Synthesizer>(std::move(model), settings);
  const NoiseModel& camera = synthesizer->model();
  return {sensor_levels(camera.layout, camera.black_dn, camera.white_dn),
          [=](const Image& clean, const GainSetting& gain, const DrawAddress& address,
              bool rounded) -> Image {
            if (!rounded) return synthesizer->draw(clean, gain, address).dn;
            const NoiseModel& camera_model = synthesizer->model();
            RawFrame frame =
                synthesizer->draw_raw(clean, gain, address, camera_model.black_dn,
                                      camera_model.white_dn > 0 ? camera_model.white_dn : 65535.0);
            subtract_black(frame);
            return std::move(frame.dn);
          },
          [synthesizer, file](const GainSetting& gain) {
            warn_of_untold_gain(synthesizer->model(), file, {gain});
          }};
}

StandIn flow_stand_in(const std::filesystem::path& file) {
  const std::shared_ptr<FlowSampler> flow = networks().open_flow(file);
  return {sensor_levels(SensorLayout::named(flow->sensor().layout), flow->sensor().black_dn,
                        flow->sensor().white_dn),
          [=](const Image& clean, const GainSetting& gain, const DrawAddress& address,
              bool rounded) -> Image {
            if (!rounded) return flow->draw(clean.view(), gain, address);
            RawFrame frame = flow->draw_raw(clean.view(), gain, address);
            subtract_black(frame);
            return std::move(frame.dn);
          }};
}

DrawAddress stand_in_address(std::uint64_t seed, int frame) {
  constexpr std::uint32_t kFirstFrame = 1u << 31;
  return {seed, kFirstFrame + static_cast<std::uint32_t>(frame), 0, 0};
}

NoiseFrames frames_drawn(const StandIn& stand_in, const NoiseFrames& reference,
                         const RawFrame& first, const std::optional<Image>& clean_dn, int count,
                         std::uint64_t seed) {
  const auto drawn = [draw = stand_in.draw, gain = first.gain, rounded = first.bits > 0, seed](
                         const Image& scene, int number) {
    return draw(scene, gain, stand_in_address(seed, number), rounded);
  };
  // Without light, under numbers of their own.
  const NoiseFrames unlit{reference.count, [&](int k) {
                            return drawn(Image(first.dn.rows(), first.dn.cols()), count + k);
                          }};
  const Image scene =
      clean_dn ? *clean_dn : uniform_scene(reference, unlit, stand_in.levels.layout);
  return {count, [=](int k) { return drawn(scene, k); }};
}

}  // namespace malus::app
