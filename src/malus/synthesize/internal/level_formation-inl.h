// One pixel of non-parametric noise, written once for every machine: included like formation-inl.h,
// by level_kernel.cpp for vectors and by scalar_formation.h for one pixel at a time. Only
// operations that IEEE 754 defines exactly.

/// One pixel's channel: numbers, and where its part of the joint tables starts.
template <class A>
struct LevelLanes {
  typename A::Real guess_start_dn, guesses_per_dn;
  typename A::Word first_guess, first_span, last_span;  ///< last_span: counted from first_span
  typename A::Word bins, first_cell, first_place, places_per_level;
};

/// noisy - clean at a finite signal. Shot word: which bin (what its product with the number of bins
/// leaves, 24 bits of it, meets the threshold); read word: place inside the bin (upper half) and
/// level (lower half).
template <class A>
MALUS_FORMATION typename A::Real level_noise(const LevelTables& tables, typename A::Real signal_dn,
                                             const LevelLanes<A>& p, typename A::Word shot_word,
                                             typename A::Word read_word) {
  using Real = typename A::Real;
  using Word = typename A::Word;
  const Real step = A::max((signal_dn - p.guess_start_dn) * p.guesses_per_dn, A::real(0.0f));
  const Word guess = A::truncated(A::min(step, A::real(static_cast<float>(kGuesses))));
  Word level = A::look_up(tables.guess, guess + p.first_guess);
  Real low, high;
  A::look_up(tables.spans, level + p.first_span, low, high);
  for (;;) {
    const auto beyond = A::both(A::at_least(signal_dn, high), A::below(level, p.last_span));
    if (A::none(beyond)) break;
    level = A::add_where(beyond, level, A::word(1));
    A::look_up(tables.spans, level + p.first_span, low, high);
  }
  const Real distance = (signal_dn - low) / (high - low) * A::real(65536.0f);
  level = A::add_where(A::real_of(read_word & A::word(0xFFFFu)) < distance, level, A::word(1));

  Word bin, rest, threshold, alias;
  A::multiply_wide(shot_word, p.bins, bin, rest);
  A::look_up(tables.cells, level * p.bins + bin + p.first_cell, threshold, alias);
  bin = A::select(A::below(A::template shifted_right<8>(rest), threshold), bin, alias);
  Real start_dn, width_dn;
  A::look_up(tables.places, level * p.places_per_level + bin + p.first_place, start_dn, width_dn);
  const Real inside =
      (A::real_of(A::template shifted_right<16>(read_word)) + A::real(0.5f)) * A::real(0x1p-16f);
  return start_dn + width_dn * inside;
}
