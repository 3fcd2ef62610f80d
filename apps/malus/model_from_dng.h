// malus model from-dng.
#pragma once

#include "program.h"

namespace malus::app {

void add_model_from_dng(CLI::App& model, Common& common);

}  // namespace malus::app
