// Who draws which words of a frame's parameters and of clean material. Two things drawn of one
// index share their words and rise and fall together: whatever is new gets an index of its own
// here.
#pragma once

#include <cstdint>

namespace malus {

/// Indices of RandomSequence(Draw::kParameters), one for each thing that is drawn for a frame:
/// redrawing one leaves the others as they are. The numbers are part of what a seed gives.
enum ParameterStream : std::uint64_t {
  kStreamMu = 0,
  kStreamSigmaRow = 1,
  kStreamSigmaTl = 2,
  kStreamGain = 3,
  kStreamDarkFrame = 16,
  kStreamDarkPlace = 17,
  kStreamDarkGain = 18,
  kStreamFlowGain = 19,    ///< one of the gains that a Noise Flow was trained at
  kStreamPair = 32,        ///< of a training pair: the model, a gain of a list, ratio, exposure
  kStreamPairSource = 33,  ///< which kind of source a training pair comes from
  kStreamJitter = 34,      ///< factors that make another sensor out of a model
};

/// Indices of Draw::kScene, as above.
enum SceneStream : std::uint64_t {
  kStreamSample = 0,        ///< of a data set: its source, patch, symmetry, ratio, gain
  kStreamPolarization = 1,  ///< relief and shine that polarize a picture
  kStreamPiece = 2,         ///< of a training example: zoom and place in its scene
  kStreamCleanScene = 3,    ///< which scene, turned or mirrored how
  kStreamFilm = 4,          ///< stress of a film
  kStreamRecordedPair = 5,  ///< which captured pair
  kStreamShardSample = 6,   ///< which sample of the shards
};

}  // namespace malus
