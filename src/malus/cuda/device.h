// Which GPU answers, and how its errors become InputError.
#pragma once

#include <string>

namespace malus::cuda {

/// Whether a device answers; without one everything else of this module throws InputError.
bool device_available();
std::string device_name();

/// Throws InputError unless the runtime's status is success; what: "copying to the device".
void check_status(int status, const char* what);

}  // namespace malus::cuda
