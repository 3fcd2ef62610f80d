"""Uformer and Restormer as plain PyTorch modules: written from their papers in the layers and the order of operations that public
code uses (tensors [batch, pixel, channel] or [batch, channel, row, column], torch.matmul, softmax), with the public names."""

import torch
from torch import nn
from torch.nn import functional as F

WINDOW = 8


def to_windows(x):
    b, h, w, c = x.shape
    return x.view(b, h // WINDOW, WINDOW, w // WINDOW, WINDOW, c).permute(0, 1, 3, 2, 4, 5).reshape(-1, WINDOW * WINDOW, c)


def from_windows(x, h, w):
    x = x.view(-1, h // WINDOW, w // WINDOW, WINDOW, WINDOW, x.shape[-1])
    return x.permute(0, 1, 3, 2, 4, 5).reshape(-1, h, w, x.shape[-1])


def shift_mask(h, w, shift, device):
    region = torch.zeros(1, h, w, 1, device=device)
    parts = (slice(0, -WINDOW), slice(-WINDOW, -shift), slice(-shift, None))
    for i, rows in enumerate(parts):
        for j, cols in enumerate(parts):
            region[:, rows, cols] = 3 * i + j
    region = to_windows(region).squeeze(-1)
    return torch.where(region[:, None] == region[:, :, None], 0.0, -100.0)


class WindowAttention(nn.Module):
    def __init__(self, dim, heads):
        super().__init__()
        self.heads, self.scale = heads, (dim // heads) ** -0.5
        self.relative_position_bias_table = nn.Parameter(0.02 * torch.randn((2 * WINDOW - 1) ** 2, heads))
        at = torch.stack(torch.meshgrid(torch.arange(WINDOW), torch.arange(WINDOW), indexing="ij")).flatten(1)
        offset = at[:, :, None] - at[:, None, :] + WINDOW - 1
        self.register_buffer("relative_position_index", offset[0] * (2 * WINDOW - 1) + offset[1])
        self.qkv = nn.Module()
        self.qkv.to_q, self.qkv.to_kv = nn.Linear(dim, dim), nn.Linear(dim, 2 * dim)
        self.proj = nn.Linear(dim, dim)

    def forward(self, x, mask):
        b, n, c = x.shape
        q = self.qkv.to_q(x).reshape(b, n, 1, self.heads, c // self.heads).permute(2, 0, 3, 1, 4)[0] * self.scale
        k, v = self.qkv.to_kv(x).reshape(b, n, 2, self.heads, c // self.heads).permute(2, 0, 3, 1, 4)
        attention = q @ k.transpose(-2, -1)
        bias = self.relative_position_bias_table[self.relative_position_index.view(-1)].view(n, n, -1)
        attention = attention + bias.permute(2, 0, 1).contiguous().unsqueeze(0)
        if mask is not None:
            windows = mask.shape[0]
            attention = attention.view(b // windows, windows, self.heads, n, n) + mask.unsqueeze(1).unsqueeze(0)
            attention = attention.view(-1, self.heads, n, n)
        return self.proj((attention.softmax(-1) @ v).transpose(1, 2).reshape(b, n, c))


class LeFF(nn.Module):
    def __init__(self, dim):
        super().__init__()
        self.linear1 = nn.Sequential(nn.Linear(dim, 4 * dim), nn.GELU())
        self.dwconv = nn.Sequential(nn.Conv2d(4 * dim, 4 * dim, 3, padding=1, groups=4 * dim), nn.GELU())
        self.linear2 = nn.Sequential(nn.Linear(4 * dim, dim))

    def forward(self, x, h, w):
        wide = self.linear1(x).transpose(1, 2).reshape(x.shape[0], -1, h, w).contiguous()
        return self.linear2(self.dwconv(wide).flatten(2).transpose(1, 2).contiguous())


class LeWinBlock(nn.Module):
    def __init__(self, dim, heads, shift, modulated):
        super().__init__()
        self.shift, self.modulator = shift, nn.Embedding(WINDOW * WINDOW, dim) if modulated else None
        self.norm1, self.attn = nn.LayerNorm(dim), WindowAttention(dim, heads)
        self.norm2, self.mlp = nn.LayerNorm(dim), LeFF(dim)

    def forward(self, x, h, w):
        b, _, c = x.shape
        y, mask = self.norm1(x).view(b, h, w, c), None
        if self.shift:
            y, mask = torch.roll(y, (-self.shift, -self.shift), (1, 2)), shift_mask(h, w, self.shift, y.device)
        windows = to_windows(y)
        if self.modulator is not None:
            windows = windows + self.modulator.weight
        y = from_windows(self.attn(windows, mask), h, w)
        if self.shift:
            y = torch.roll(y, (self.shift, self.shift), (1, 2))
        x = x + y.view(b, h * w, c)
        return x + self.mlp(self.norm2(x), h, w)


class Stage(nn.Module):
    def __init__(self, dim, heads, depth, size, modulated):
        super().__init__()
        shifts = [WINDOW // 2 if i % 2 and size > WINDOW else 0 for i in range(depth)]
        self.blocks = nn.ModuleList(LeWinBlock(dim, heads, shift, modulated) for shift in shifts)

    def forward(self, x, h, w):
        for block in self.blocks:
            x = block(x, h, w)
        return x


class Resample(nn.Module):
    def __init__(self, name, layer):
        super().__init__()
        setattr(self, name, nn.Sequential(layer))
        self.name = name

    def forward(self, x, h, w):
        x = getattr(self, self.name)(x.transpose(1, 2).contiguous().view(x.shape[0], -1, h, w))
        return x.flatten(2).transpose(1, 2).contiguous()


class Uformer(nn.Module):
    """Sizes in multiples of 128, without a global residual (as for other than three channels)."""

    def __init__(self, channels=16, dim=32, depths=(2,) * 9, heads=(1, 2, 4, 8, 16, 16, 8, 4, 2), size=128):
        super().__init__()
        self.input_proj, self.output_proj = nn.Module(), nn.Module()
        self.input_proj.proj = nn.Sequential(nn.Conv2d(channels, dim, 3, padding=1), nn.LeakyReLU())
        for i in range(4):
            setattr(self, f"encoderlayer_{i}", Stage(dim << i, heads[i], depths[i], size >> i, False))
            setattr(self, f"dowsample_{i}", Resample("conv", nn.Conv2d(dim << i, dim << (i + 1), 4, 2, 1)))
        self.conv = Stage(dim << 4, heads[4], depths[4], size >> 4, False)
        for i in range(4):
            to = dim << (3 - i)
            setattr(self, f"upsample_{i}", Resample("deconv", nn.ConvTranspose2d(dim << 4 if i == 0 else 4 * to, to, 2, 2)))
            setattr(self, f"decoderlayer_{i}", Stage(2 * to, heads[5 + i], depths[5 + i], size >> (3 - i), True))
        self.output_proj.proj = nn.Sequential(nn.Conv2d(2 * dim, channels, 3, padding=1))

    def forward(self, x):
        h, w = x.shape[2:]
        x = self.input_proj.proj(x).flatten(2).transpose(1, 2).contiguous()
        skips = []
        for i in range(4):
            x = getattr(self, f"encoderlayer_{i}")(x, h >> i, w >> i)
            skips.append(x)
            x = getattr(self, f"dowsample_{i}")(x, h >> i, w >> i)
        x = self.conv(x, h >> 4, w >> 4)
        for i in range(4):
            x = getattr(self, f"upsample_{i}")(x, h >> (4 - i), w >> (4 - i))
            x = getattr(self, f"decoderlayer_{i}")(torch.cat([x, skips[3 - i]], -1), h >> (3 - i), w >> (3 - i))
        return self.output_proj.proj(x.transpose(1, 2).view(x.shape[0], -1, h, w))


class BiasFreeNorm(nn.Module):
    def __init__(self, dim):
        super().__init__()
        self.body = nn.Module()
        self.body.weight = nn.Parameter(torch.ones(dim))

    def forward(self, x):
        b, c, h, w = x.shape
        x = x.flatten(2).transpose(1, 2)
        x = x / torch.sqrt(x.var(-1, keepdim=True, unbiased=False) + 1e-5) * self.body.weight
        return x.transpose(1, 2).reshape(b, c, h, w)


class TransposedAttention(nn.Module):
    def __init__(self, dim, heads):
        super().__init__()
        self.heads, self.temperature = heads, nn.Parameter(torch.ones(heads, 1, 1))
        self.qkv = nn.Conv2d(dim, 3 * dim, 1, bias=False)
        self.qkv_dwconv = nn.Conv2d(3 * dim, 3 * dim, 3, padding=1, groups=3 * dim, bias=False)
        self.project_out = nn.Conv2d(dim, dim, 1, bias=False)

    def forward(self, x):
        b, c, h, w = x.shape
        q, k, v = (part.reshape(b, self.heads, c // self.heads, h * w) for part in self.qkv_dwconv(self.qkv(x)).chunk(3, 1))
        q, k = F.normalize(q, dim=-1), F.normalize(k, dim=-1)
        attention = ((q @ k.transpose(-2, -1)) * self.temperature).softmax(-1)
        return self.project_out((attention @ v).reshape(b, c, h, w))


class GatedFeedForward(nn.Module):
    def __init__(self, dim):
        super().__init__()
        hidden = int(dim * 2.66)
        self.project_in = nn.Conv2d(dim, 2 * hidden, 1, bias=False)
        self.dwconv = nn.Conv2d(2 * hidden, 2 * hidden, 3, padding=1, groups=2 * hidden, bias=False)
        self.project_out = nn.Conv2d(hidden, dim, 1, bias=False)

    def forward(self, x):
        first, second = self.dwconv(self.project_in(x)).chunk(2, 1)
        return self.project_out(F.gelu(first) * second)


class TransformerBlock(nn.Module):
    def __init__(self, dim, heads):
        super().__init__()
        self.norm1, self.attn = BiasFreeNorm(dim), TransposedAttention(dim, heads)
        self.norm2, self.ffn = BiasFreeNorm(dim), GatedFeedForward(dim)

    def forward(self, x):
        x = x + self.attn(self.norm1(x))
        return x + self.ffn(self.norm2(x))


def resample(from_, to, shuffle):
    layer = nn.Module()
    layer.body = nn.Sequential(nn.Conv2d(from_, to, 3, padding=1, bias=False), shuffle)
    return layer


class Restormer(nn.Module):
    """Bias-free norm, sizes in multiples of 8, with the global residual."""

    def __init__(self, channels=16, dim=48, blocks=(4, 6, 6, 8), refinement=4, heads=(1, 2, 4, 8)):
        super().__init__()
        def stage(width, level, count):
            return nn.Sequential(*[TransformerBlock(width, heads[level]) for _ in range(count)])
        self.patch_embed = nn.Module()
        self.patch_embed.proj = nn.Conv2d(channels, dim, 3, padding=1, bias=False)
        for i in range(3):
            setattr(self, f"encoder_level{i + 1}", stage(dim << i, i, blocks[i]))
            setattr(self, f"down{i + 1}_{i + 2}", resample(dim << i, dim << i >> 1, nn.PixelUnshuffle(2)))
            setattr(self, f"up{i + 2}_{i + 1}", resample(dim << (i + 1), dim << (i + 2), nn.PixelShuffle(2)))
            setattr(self, f"decoder_level{i + 1}", stage(dim << max(i, 1), i, blocks[i]))
            if i:
                setattr(self, f"reduce_chan_level{i + 1}", nn.Conv2d(dim << (i + 1), dim << i, 1, bias=False))
        self.latent = stage(dim << 3, 3, blocks[3])
        self.refinement = stage(2 * dim, 0, refinement)
        self.output = nn.Conv2d(2 * dim, channels, 3, padding=1, bias=False)

    def forward(self, image):
        x, skips = self.patch_embed.proj(image), []
        for i in range(3):
            x = getattr(self, f"encoder_level{i + 1}")(x)
            skips.append(x)
            x = getattr(self, f"down{i + 1}_{i + 2}").body(x)
        x = self.latent(x)
        for i in (2, 1, 0):
            x = torch.cat([getattr(self, f"up{i + 2}_{i + 1}").body(x), skips[i]], 1)
            x = getattr(self, f"decoder_level{i + 1}")(getattr(self, f"reduce_chan_level{i + 1}")(x) if i else x)
        return self.output(self.refinement(x)) + image
