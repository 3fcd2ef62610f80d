// What a fuzz target is: one function that hands bytes to one of our parsers. fuzz/entry.cpp makes
// a libFuzzer program of it, tests/fuzz/replay.cpp an ordinary test.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

/// Bytes that the parser refuses must throw malus::InputError; anything else that goes wrong
/// (another exception, an abort, a sanitizer's finding) is a fault.
void parse_bytes(std::span<const std::uint8_t> bytes);
