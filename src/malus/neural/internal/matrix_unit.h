// Products of rounded values in a processor's matrix unit: Intel's AMX with bfloat16, from the
// fourth generation of Xeons (Sapphire Rapids) on, under Linux.
#pragma once

#include "malus/neural/internal/kernels.h"

namespace malus::internal {

/// Whether this process may use one. The first call asks the system for it.
bool has_matrix_unit();

/// p, whose pairs are set, with the rounded values a in place of its own; one value more is
/// readable behind them. Needs has_matrix_unit().
void multiply_in_matrix_unit(const MatrixProduct& p, const Bfloat16* a);

}  // namespace malus::internal
