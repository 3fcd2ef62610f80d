// What libtorch throws, as what the rest of malus knows. Names no libtorch type.
#pragma once

namespace malus {

/// To be called while an exception is handled: libtorch's own becomes InputError (or std::bad_alloc
/// where memory was missing), every other goes on as it is. remedy: what the user can do.
[[noreturn]] void rethrow_libtorch_failure(const char* remedy);

}  // namespace malus
