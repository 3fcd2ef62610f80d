// malus model import-weights.
#pragma once

#include "program.h"

namespace malus::app {

void add_import_weights(CLI::App& model, Common& common);

}  // namespace malus::app
