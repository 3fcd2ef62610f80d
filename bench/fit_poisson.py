"""Fits the correction E(w, m) of the asymptotic inverse of the Poisson distribution function
(src/malus/synthesize/formation-inl.h, shot_large) and prints its coefficients and errors.

N = floor(x), where x solves Gamma(x, m)/Gamma(x) = Phi(w); x = m + sqrt(m) w + E(w, m),
E = w² G(t) + H(t) + J(t)/m, t = w/sqrt(m), the first two coefficients of G and H known
(1/6, -1/72; 1/3, -1/36). Minimax by iterated weights, tails weighted down by (1 + (w/2.2)^6).
"""
import numpy as np
from scipy.special import gammainc, gammaincc, ndtr

FROM_M, DEGREE_G, DEGREE_H, DEGREE_J = 5.0, 8, 5, 3


def inverse(w, m):
    low = np.full_like(w, 1e-9)
    high = m + (np.abs(w) + 3) * np.sqrt(m) + w * w + 10
    upper = w > 0
    for _ in range(80):
        middle = 0.5 * (low + high)
        tail = np.where(upper, gammainc(middle, m), gammaincc(middle, m))
        target = np.where(upper, ndtr(-w), ndtr(w))
        too_large = np.where(upper, tail < target, tail > target)
        high = np.where(too_large, middle, high)
        low = np.where(too_large, low, middle)
    return 0.5 * (low + high)


def main():
    w, m = np.meshgrid(np.linspace(-6.3, 6.3, 253),
                       FROM_M * np.exp(np.linspace(0, np.log(2e4 / FROM_M), 60)))
    x = inverse(w, m)
    use = x > 1.0  # below, N = 0 whatever E is
    w, m, x = w[use], m[use], x[use]
    t = w / np.sqrt(m)
    rest = x - m - np.sqrt(m) * w - (w * w * (1 / 6 - t / 72) + 1 / 3 - t / 36)
    columns = ([w * w * t**k for k in range(2, DEGREE_G + 1)]
               + [t**k for k in range(2, DEGREE_H + 1)] + [t**k / m for k in range(DEGREE_J + 1)])
    a = np.stack(columns, 1)
    importance = 1 / (1 + (w / 2.2) ** 6)
    weight = np.ones_like(importance)
    for _ in range(40):
        scale = importance * weight
        c = np.linalg.lstsq(a * scale[:, None], rest * scale, rcond=None)[0]
        residual = np.abs(a @ c - rest) * importance
        weight *= (residual / residual.max() + 1e-3) ** 0.3
        weight /= weight.max()
    error = np.abs(a @ c - rest)
    for low, high in ((0, 2), (2, 3), (3, 4), (4, 5), (5, 6.4)):
        inside = (np.abs(w) >= low) & (np.abs(w) < high)
        print(f"|w| {low} to {high}: error below {error[inside].max():.1e} electrons")
    g, h = DEGREE_G - 1, DEGREE_H - 1
    for name, values in (("G, from t^2", c[:g]), ("H, from t^2", c[g:g + h]), ("J", c[g + h:])):
        print(name, *(f"{v:.9g}" for v in values))


if __name__ == "__main__":
    main()
