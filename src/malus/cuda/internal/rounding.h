// Whether this device rounds the drawing kernel's roots and reciprocals as IEEE 754 does, on which
// the CPU's bits rest.
#pragma once

namespace malus::cuda {

/// Arguments for which the kernel's shortcut (rounded_sqrt, rounded_reciprocal) gives other bits
/// than the device's IEEE-rounded operation: of all finite floats from 5 electrons on, where the
/// kernel uses them, reciprocals up to 2^126. Throws InputError where no device answers.
struct RoundingDifferences {
  unsigned roots = 0, reciprocals = 0;
};
RoundingDifferences rounding_differences();

}  // namespace malus::cuda
