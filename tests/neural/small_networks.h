// Every architecture at its smallest with four planes in and out.
#pragma once

#include "malus/neural/network.h"

#include <string>

namespace malus::testing {

inline NetworkDescription small_network(const std::string& name) {
  if (name == "unet") return {name, {{"in_channels", 4}, {"out_channels", 4}, {"width", 4}}};
  if (name == "nafnet")
    return {name,
            {{"img_channel", 4},
             {"width", 4},
             {"middle_blk_num", 1},
             {"enc_blk_nums", {1, 1}},
             {"dec_blk_nums", {1, 1}}}};
  if (name == "restormer")
    return {name,
            {{"inp_channels", 4},
             {"out_channels", 4},
             {"dim", 8},
             {"num_blocks", {1, 1, 1, 1}},
             {"num_refinement_blocks", 1},
             {"heads", {1, 1, 1, 1}}}};
  if (name == "uformer")
    return {name,
            {{"in_chans", 4},
             {"dd_in", 4},
             {"embed_dim", 4},
             {"num_heads", {1, 1, 1, 1, 1, 1, 1, 1, 1}}}};
  return {name,
          {{"in_channels", 4},
           {"out_channels", 4},
           {"dim", 8},
           {"depths", {2, 1, 1, 1}},
           {"heads", {1, 1, 2, 2}}}};
}

}  // namespace malus::testing
