// The main path by one include: frames and pictures in and out, calibration and its data sheet,
// synthesis, denoising and what speaks against its result, polarization and its errors, evaluation.
// What else the library has comes by headers of its own.
#pragma once

#include "malus/calibrate/calibrate.h"
#include "malus/denoise/denoiser.h"
#include "malus/denoise/estimate_noise.h"
#include "malus/denoise/frame_complaints.h"
#include "malus/denoise/frame_profile.h"
#include "malus/evaluate/evaluation.h"
#include "malus/evaluate/noise_comparison.h"
#include "malus/image/pack.h"
#include "malus/io/frame_file.h"
#include "malus/io/picture_file.h"
#include "malus/io/session.h"
#include "malus/noise/data_sheet.h"
#include "malus/noise/frame_levels.h"
#include "malus/noise/model.h"
#include "malus/polar/demosaick.h"
#include "malus/polar/layout_check.h"
#include "malus/polar/normals.h"
#include "malus/polar/stokes.h"
#include "malus/polar/uncertainty.h"
#include "malus/synthesize/model.h"
#include "malus/synthesize/model_renoiser.h"
#include "malus/synthesize/scene.h"
