// What a converter's rounding does beyond noise. Where the noise before it has half a step's
// deviation or more, rounding adds step²/12 that averages out; below, samples of one signal agree
// on the wrong number, and no averaging finds the right one.
#pragma once

namespace malus {

/// Mean square of the offset between a signal and the mean of its rounded samples, over all places
/// of the signal within a step [DN²]: step² Σ exp(-4π²k²σ²/step²) / (2π²k²), k = 1, 2, ... (the
/// harmonics of rounding's saw tooth, damped by Gaussian noise of deviation σ: Widrow, Kollár,
/// "Quantization Noise", 2008, ch. 19). step²/12 without noise, 1 % of that at 0.32 steps.
/// step_dn >= 0, variance_dn2 = σ² >= 0: of the noise before the converter.
double undithered_variance(double step_dn, double variance_dn2);

/// Variance of the rounded samples of a signal that lies offset_dn beside a code [DN²], for
/// Gaussian noise of variance_dn2 = σ² > 0 before a converter with step_dn > 0: next to nothing on
/// a code, up to step²/4 between two, where the step hides the noise.
double rounded_variance(double step_dn, double offset_dn, double variance_dn2);

/// The most noise, before a converter with step_dn > 0, of which rounded samples show no more than
/// variance_dn2 [DN²]: that of a signal on a code, which shows least.
double most_rounded_noise(double step_dn, double variance_dn2);

/// Variance of dark pixels [step²] below which the step hides the noise: EMVA 1288 then states the
/// noise of this limit, less the step²/12 of rounding.
inline constexpr double kLeastDarkVariance = 0.24;

}  // namespace malus
