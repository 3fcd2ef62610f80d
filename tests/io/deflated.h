// What TIFF calls Deflate: zlib's compression of a strip or tile.
#pragma once

#include <string>

#include <zlib.h>

namespace malus::testing {

inline std::string deflated(const std::string& bytes) {
  uLongf size = compressBound(static_cast<uLong>(bytes.size()));
  std::string out(size, '\0');
  compress(reinterpret_cast<Bytef*>(out.data()), &size,
           reinterpret_cast<const Bytef*>(bytes.data()), static_cast<uLong>(bytes.size()));
  out.resize(size);
  return out;
}

}  // namespace malus::testing
