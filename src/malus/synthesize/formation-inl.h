// One pixel of compiled noise, written once for every machine. The including file defines, in its
// own namespace, `struct Arithmetic` with the types Real (float), Word (uint32) and Truth and the
// operations used below; this file has no include guard because the vector code includes it once
// per instruction set (compiled_kernel.cpp) and the scalar twin once more (scalar_formation.h).
//
// Every operation is one that IEEE 754 defines exactly (+ - * / sqrt, fused multiply-add, floor,
// comparison), so that all instruction sets give the same bits from the same words.

/// One pixel's channel parameters.
template <class A>
struct ChannelLanes {
  typename A::Real gain_dn, electrons_per_dn, variance_dn2, scale_dn, offset_dn;
  typename A::Word first_line;
};

/// Standard deviate of a symmetric distribution: `lines` as in quantile_table.h, `first` the number
/// of its cell 0.
template <class A>
MALUS_FORMATION typename A::Real symmetric_deviate(const TailLine* lines, typename A::Word first,
                                                   typename A::Word word) {
  const auto x = A::tail_position(word);
  typename A::Real a, b;
  A::look_up(lines, A::cell_of(x) + first, a, b);
  // The upper half carries the sign bit in its word; below the median the deviate is negative.
  return A::flip_sign_unless_top_bit(A::multiply_add(b, x, a), word);
}

/// Horner's scheme, highest coefficient first.
template <class A, int N>
MALUS_FORMATION typename A::Real polynomial(const float (&c)[N], typename A::Real x) {
  typename A::Real sum = A::real(c[0]);
  for (int i = 1; i < N; ++i) sum = A::multiply_add(sum, x, A::real(c[i]));
  return sum;
}

/// The same as two schemes in x² side by side, for half of the wait on multiply-adds.
template <class A, int N>
MALUS_FORMATION typename A::Real polynomial(const float (&c)[N], typename A::Real x,
                                            typename A::Real x2) {
  typename A::Real first = A::real(c[0]), second = A::real(c[1]);
  for (int i = 2; i + 1 < N; i += 2) {
    first = A::multiply_add(first, x2, A::real(c[i]));
    second = A::multiply_add(second, x2, A::real(c[i + 1]));
  }
  if constexpr (N % 2 == 0) return A::multiply_add(first, x, second);
  return A::multiply_add(A::multiply_add(first, x, second), x, A::real(c[N - 1]));
}

/// N - m for N ~ Poisson(m), m >= kShotSmall, from a normal deviate w of the same word: the
/// asymptotic inverse of the Poisson distribution function, N = floor(m + sqrt(m) w + E(w, m)).
/// Leading terms: Giles, "Algorithm 955: approximation of the inverse Poisson cumulative
/// distribution function", ACM TOMS 42 (2016), eq. (3); the rest of E = w² G(t) + H(t) + J(t)/m,
/// t = w/sqrt(m), fitted to the inverse of the incomplete gamma function for m from 5 to 2e4
/// (bench/fit_poisson.py): |error| < 1e-4 electrons for |w| < 2, 5e-4 for |w| < 3, 1e-2 for
/// |w| < 5.
template <class A>
MALUS_FORMATION typename A::Real shot_large(typename A::Real m, typename A::Real w) {
  using Real = typename A::Real;
  constexpr float kG[] = {-2.80790406e-05f, 0.000100097845f, 0.000151410014f,
                          -0.000895072489f, 0.000833576015f, -0.000981449518f,
                          0.00387849197f,   -1.0f / 72.0f,   1.0f / 6.0f};
  constexpr float kH[] = {0.00284366384f, -0.00295310537f, -0.00618353493f,
                          0.00877975609f, -1.0f / 36.0f,   1.0f / 3.0f};
  constexpr float kJ[] = {0.0116514197f, -0.00900972984f, 0.0189948401f, -0.0200593883f};
  // The root and the reciprocal take long: neither waits for the other.
  Real root, reciprocal;
  A::root_and_reciprocal(m, root, reciprocal);
  const Real t = w * (root * reciprocal), t2 = t * t;
  const Real correction =
      A::multiply_add(polynomial<A>(kJ, t, t2), reciprocal,
                      A::multiply_add(polynomial<A>(kG, t, t2), w * w, polynomial<A>(kH, t, t2)));
  // All that follows is relative to floor(m), so that a bright pixel loses no digits.
  const Real whole = A::floor(m), fraction = m - whole;
  const Real count = A::floor(A::multiply_add(root, w, fraction + correction));
  return A::max(count, A::real(0.0f) - whole) - fraction;
}

/// exp(-m) for 0 <= m <= kShotSmall: 2^-n times the Taylor polynomial of exp(-r), |r| <= ln2/2;
/// relative error < 2e-7.
template <class A>
MALUS_FORMATION typename A::Real exp_minus(typename A::Real m) {
  using Real = typename A::Real;
  const Real n = A::floor(A::multiply_add(m, A::real(1.44269504f), A::real(0.5f)));
  Real r = A::multiply_add(n, A::real(-0.693145752f), m);  // ln 2 in two parts, the first exact
  r = A::multiply_add(n, A::real(-1.42860677e-6f), r);
  constexpr float kTaylor[] = {1.0f / 720, -1.0f / 120, 1.0f / 24, -1.0f / 6, 0.5f, -1.0f, 1.0f};
  return A::scale_down(polynomial<A>(kTaylor, r), n);
}

/// N for N ~ Poisson(m), 0 <= m < kShotSmall, by summing probabilities until they exceed the
/// uniform of the word. Single precision leaves 1e-7 of absolute error in the sum, too much for the
/// upper tail: the caller replaces the draws of its outermost kShotTailWords (shot_upper_tail).
template <class A>
MALUS_FORMATION typename A::Real shot_small(typename A::Real m, typename A::Word word) {
  using Real = typename A::Real;
  static constexpr float kReciprocal[kShotSmallMost + 1] = {
      0,         1,         1.0f / 2,  1.0f / 3,  1.0f / 4,  1.0f / 5,  1.0f / 6,  1.0f / 7,
      1.0f / 8,  1.0f / 9,  1.0f / 10, 1.0f / 11, 1.0f / 12, 1.0f / 13, 1.0f / 14, 1.0f / 15,
      1.0f / 16, 1.0f / 17, 1.0f / 18, 1.0f / 19, 1.0f / 20, 1.0f / 21, 1.0f / 22, 1.0f / 23,
      1.0f / 24, 1.0f / 25, 1.0f / 26, 1.0f / 27, 1.0f / 28};
  const Real p = A::tail_position(word) * A::real(0x1p-32f);
  Real left = A::select_top_bit(word, A::real(1.0f) - p, p);
  Real probability = exp_minus<A>(m), count = A::real(0.0f);
  // Four terms between tests: a branch that cannot be foreseen costs more than a term.
  for (int k = 1; k <= kShotSmallMost; k += 4) {
    typename A::Truth beyond{};
    for (int i = 0; i < 4; ++i) {
      left = left - probability;
      beyond = left > A::real(0.0f);
      count = A::add_where(beyond, count, A::real(1.0f));
      probability = probability * (m * A::real(kReciprocal[k + i]));
    }
    if (A::none(beyond)) break;
  }
  return count;
}

/// N - m for N ~ Poisson(m), any m; negative m counts as 0. One word.
template <class A>
MALUS_FORMATION typename A::Real shot_noise(typename A::Real m, typename A::Word word,
                                            const TailLine* normal) {
  using Real = typename A::Real;
  const Real limit = A::real(kShotSmall);
  const auto is_small = m < limit;
  Real small = A::real(0.0f);
  if (!A::none(is_small)) {
    const Real mean = A::select(is_small, A::max(m, A::real(0.0f)), A::real(0.0f));
    Real count = shot_small<A>(mean, word);
    const auto in_tail = A::both(is_small, A::deep_upper_tail(word));
    if (!A::none(in_tail)) count = A::shot_upper_tail_where(in_tail, mean, word, count);
    small = count - mean;
    if (A::all(is_small)) return small;
  }
  const Real w = symmetric_deviate<A>(normal, A::word(0u - kTailFirst), word);
  return A::select(is_small, small, shot_large<A>(A::max(m, limit), w));
}

/// Quantisation noise in steps, uniform in (-1/2, 1/2), from the low 12 bits of the shot word. The
/// count of electrons depends on them in one draw of a thousand at most, and then only on which
/// side of a 2^-20 wide cell it falls, so the two are independent for every purpose.
template <class A>
MALUS_FORMATION typename A::Real quantization_noise(typename A::Word shot_word) {
  return A::multiply_add(A::real_of(shot_word & A::word(0xFFFu)), A::real(0x1p-12f),
                         A::real(0.5f * 0x1p-12f - 0.5f));
}

/// One pixel, 000 Eq. 1: D = s + K (N - s/K) + mu + sigma_b z + sigma_TL T + q U. Per-channel
/// parameters in `p`, read tables and switches in `row`: FormationTables, or a type with the same
/// members whose switches the compiler knows.
template <class A, class Tables>
MALUS_FORMATION typename A::Real noisy_pixel(typename A::Real signal_dn, const ChannelLanes<A>& p,
                                             const Tables& row, typename A::Word shot_word,
                                             typename A::Word read_word) {
  using Real = typename A::Real;
  Real noise = p.offset_dn;
  if (row.shot == ShotKind::kPoisson) {
    const Real m = signal_dn * p.electrons_per_dn;
    noise = A::multiply_add(p.gain_dn, shot_noise<A>(m, shot_word, row.normal), noise);
  } else if (row.shot == ShotKind::kGaussian) {
    // Negative light has no shot noise, not a negative one.
    const Real variance =
        A::multiply_add(p.gain_dn, A::max(signal_dn, A::real(0.0f)), p.variance_dn2);
    const Real w = symmetric_deviate<A>(row.normal, A::word(0u - kTailFirst), shot_word);
    noise = A::multiply_add(A::sqrt(A::max(variance, A::real(0.0f))), w, noise);
  }
  if (row.has_read())
    noise =
        A::multiply_add(p.scale_dn, symmetric_deviate<A>(row.read, p.first_line, read_word), noise);
  if (row.quantizes())
    noise = A::multiply_add(A::real(row.quantization_dn), quantization_noise<A>(shot_word), noise);
  // NaN and infinities stay what they are.
  return A::select(A::finite(signal_dn), signal_dn + noise, signal_dn);
}
