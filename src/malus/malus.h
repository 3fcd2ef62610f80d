// The whole library by one include.
#pragma once

#include "malus/calibrate/calibrate.h"
#include "malus/denoise/denoiser.h"
#include "malus/denoise/estimate_noise.h"
#include "malus/denoise/frame_profile.h"
#include "malus/evaluate/evaluation.h"
#include "malus/io/frame_file.h"
#include "malus/io/picture_file.h"
#include "malus/io/session.h"
#include "malus/noise/model.h"
#include "malus/polar/stokes.h"
#include "malus/synthesize/model.h"
