// The architectures, each with its settings; network.h is the door to them.
#pragma once

#include "malus/neural/network.h"

namespace malus {

/// See-in-the-Dark U-Net (Chen et al., CVPR 2018): five levels of two 3x3 convolutions, LeakyReLU
/// 0.2, transposed convolutions up, skip connections. Settings: in_channels, out_channels, width
/// (32), levels (5), upscale (1: as large as the input; 2: a head that gives pictures of twice the
/// planes' size by pixel shuffle, which is how a Bayer mosaic's four planes become RGB: joint
/// denoising and demosaicking, neural ISP; 001, S4 and S6).
std::shared_ptr<Network> make_unet(const nlohmann::json& settings);

/// NAFNet (Chen et al., ECCV 2022). Settings: img_channel, width, middle_blk_num, enc_blk_nums,
/// dec_blk_nums.
std::shared_ptr<Network> make_nafnet(const nlohmann::json& settings);

/// Restormer (Zamir et al., CVPR 2022): transposed attention over channels, gated feed-forward.
/// Settings: inp_channels, out_channels, dim, num_blocks, num_refinement_blocks, heads,
/// ffn_expansion_factor, bias, LayerNorm_type ("BiasFree" or "WithBias").
std::shared_ptr<Network> make_restormer(const nlohmann::json& settings);

/// Uformer (Wang et al., CVPR 2022): windows of 8, shifted in every odd block, LeFF, modulators in
/// the decoder. Settings: img_size, in_chans, dd_in, embed_dim, depths, num_heads, win_size,
/// token_projection, token_mlp, modulator.
std::shared_ptr<Network> make_uformer(const nlohmann::json& settings);

/// The hybrid-attention transformer of paper 000, section 5.2; widths are ours (docs/networks.md).
/// Settings: in_channels, out_channels, dim, depths (4 stages), heads, window.
std::shared_ptr<Network> make_hybrid(const nlohmann::json& settings);

}  // namespace malus
