// log |Γ(x)| that threads may call together.
#pragma once

#include "malus/base/host_device.h"

#if !defined(__CUDACC__)
#include <math.h>  // lgamma_r, which <cmath> does not name
#endif

namespace malus {

/// log |Γ(x)|, the same bits as std::lgamma, which also writes the sign to a global (signgam): a
/// race between threads.
MALUS_HOST_DEVICE inline double log_gamma(double x) {
#if defined(__CUDACC__)
  return lgamma(x);
#else
  int sign = 0;
  return lgamma_r(x, &sign);
#endif
}

}  // namespace malus
