// A grey frame as the simulated polarization camera would see it at 24 dB, denoised again.
#include <iostream>

#include <malus/malus.h>

int main() {
  const auto model = malus::Model::load("imx250myr-simulated");
  malus::Image clean(256, 256, 200.0f), noisy(256, 256);
  model.at_gain(24).synthesize(clean, noisy, /*seed=*/1, /*frame=*/0);

  malus::RawFrame frame;
  frame.dn = noisy;
  frame.layout = model.description().layout;
  frame.black_dn.assign(16, 0.0);
  frame.white_dn = 4013;
  frame.white_known = true;
  const malus::DenoiseSettings settings;
  const malus::FrameProfile noise =
      malus::frame_profile(frame, model.description(), model.gain_setting(24), settings);
  if (!noise.left_out.empty()) std::cerr << noise.left_out << "\n";
  const auto result = malus::denoise_frame(frame, noise.profile, settings);
  std::cout << "pixel (100, 100): clean 200 DN, noisy " << noisy(100, 100) << " DN, denoised "
            << result.dn_above_black(100, 100) << " DN\n";
}
