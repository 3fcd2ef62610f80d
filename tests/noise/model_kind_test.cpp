#include "malus/noise/model_kind.h"

#include "malus/base/error.h"

#include <string>
#include <vector>

#include "../problem_of.h"
#include <gmock/gmock.h>

namespace malus {
namespace {

TEST(ModelKind, NamesAreReadBack) {
  EXPECT_THAT(model_kind_names(),
              ::testing::ElementsAre("physics", "gaussian", "nonparametric", "dark-frames"));
  const std::vector<ModelKind> kinds = model_kinds(model_kind_names());
  EXPECT_EQ(model_kind_names(kinds), model_kind_names());
  EXPECT_THAT(kinds, ::testing::ElementsAre(ModelKind::kPhysics, ModelKind::kGaussian,
                                            ModelKind::kNonparametric, ModelKind::kDarkFrames));
}

TEST(ModelKind, OfAnotherNameIsRefused) {
  for (const char* name : {"", "Physics", "poisson-gaussian", "dark_frames"})
    EXPECT_THROW((void)model_kinds({"physics", name}), InputError) << name;
  EXPECT_EQ(testing::problem_of([] { (void)model_kind("physic"); }),
            "kinds: physic is not a kind of model; choose of physics, gaussian, nonparametric, "
            "dark-frames");
}

}  // namespace
}  // namespace malus
