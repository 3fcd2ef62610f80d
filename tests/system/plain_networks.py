"""U-Net (See-in-the-Dark) and NAFNet as plain PyTorch modules, written from their papers, with the public names."""

import torch
from torch import nn
from torch.nn import functional as F


class UNet(nn.Module):
    def __init__(self, channels=16, out=16, width=32):
        super().__init__()
        size = channels
        for level in range(1, 6):
            to = width << (level - 1)
            setattr(self, f"conv{level}_1", nn.Conv2d(size, to, 3, padding=1))
            setattr(self, f"conv{level}_2", nn.Conv2d(to, to, 3, padding=1))
            size = to
        for level in range(6, 10):
            setattr(self, f"upv{level}", nn.ConvTranspose2d(size, size // 2, 2, stride=2))
            setattr(self, f"conv{level}_1", nn.Conv2d(size, size // 2, 3, padding=1))
            setattr(self, f"conv{level}_2", nn.Conv2d(size // 2, size // 2, 3, padding=1))
            size //= 2
        self.conv10_1 = nn.Conv2d(size, out, 1)

    def pair(self, level, x):
        for part in (1, 2):
            x = F.leaky_relu(getattr(self, f"conv{level}_{part}")(x), 0.2)
        return x

    def forward(self, x):
        skips = []
        for level in range(1, 6):
            x = self.pair(level, F.max_pool2d(x, 2) if level > 1 else x)
            skips.append(x)
        for level in range(6, 10):
            x = self.pair(level, torch.cat([getattr(self, f"upv{level}")(x), skips[9 - level]], 1))
        return self.conv10_1(x)


class PixelNorm(nn.Module):
    def __init__(self, channels):
        super().__init__()
        self.weight, self.bias = nn.Parameter(torch.ones(channels)), nn.Parameter(torch.zeros(channels))

    def forward(self, x):
        return F.layer_norm(x.permute(0, 2, 3, 1), x.shape[1:2], self.weight, self.bias, 1e-6).permute(0, 3, 1, 2)


def gate(x):
    first, second = x.chunk(2, 1)
    return first * second


class NAFBlock(nn.Module):
    def __init__(self, c):
        super().__init__()
        self.conv1, self.conv2 = nn.Conv2d(c, 2 * c, 1), nn.Conv2d(2 * c, 2 * c, 3, padding=1, groups=2 * c)
        self.conv3, self.conv4, self.conv5 = nn.Conv2d(c, c, 1), nn.Conv2d(c, 2 * c, 1), nn.Conv2d(c, c, 1)
        self.sca = nn.Sequential(nn.AdaptiveAvgPool2d(1), nn.Conv2d(c, c, 1))
        self.norm1, self.norm2 = PixelNorm(c), PixelNorm(c)
        self.beta, self.gamma = nn.Parameter(torch.zeros(1, c, 1, 1)), nn.Parameter(torch.zeros(1, c, 1, 1))

    def forward(self, x):
        inner = gate(self.conv2(self.conv1(self.norm1(x))))
        x = x + self.conv3(inner * self.sca(inner)) * self.beta
        return x + self.conv5(gate(self.conv4(self.norm2(x)))) * self.gamma


class NAFNet(nn.Module):
    def __init__(self, channels=16, width=32, middle=12, encoder=(2, 2, 4, 8), decoder=(2, 2, 2, 2)):
        super().__init__()
        self.intro, self.ending = nn.Conv2d(channels, width, 3, padding=1), nn.Conv2d(width, channels, 3, padding=1)
        self.encoders, self.decoders, self.ups, self.downs = (nn.ModuleList() for _ in range(4))
        c = width
        for count in encoder:
            self.encoders.append(nn.Sequential(*[NAFBlock(c) for _ in range(count)]))
            self.downs.append(nn.Conv2d(c, 2 * c, 2, stride=2))
            c *= 2
        self.middle_blks = nn.Sequential(*[NAFBlock(c) for _ in range(middle)])
        for count in decoder:
            self.ups.append(nn.Sequential(nn.Conv2d(c, 2 * c, 1, bias=False), nn.PixelShuffle(2)))
            c //= 2
            self.decoders.append(nn.Sequential(*[NAFBlock(c) for _ in range(count)]))

    def forward(self, x):
        y, skips = self.intro(x), []
        for blocks, down in zip(self.encoders, self.downs):
            y = blocks(y)
            skips.append(y)
            y = down(y)
        y = self.middle_blks(y)
        for blocks, up, skip in zip(self.decoders, self.ups, reversed(skips)):
            y = blocks(up(y) + skip)
        return self.ending(y) + x
