#include "malus/report/internal/embedded_page.h"

// The assembler reads the file: no generated source, and no wait for a compiler to parse 600 kB of
// text.
asm(R"(
  .section .rodata
  .global malus_report_page
  .global malus_report_page_end
malus_report_page:
  .incbin ")" MALUS_REPORT_PAGE R"("
malus_report_page_end:
  .byte 0
  .previous
)");

extern "C" const char malus_report_page[];
extern "C" const char malus_report_page_end[];

namespace malus::internal {

std::string_view embedded_page() {
  return {malus_report_page, static_cast<std::size_t>(malus_report_page_end - malus_report_page)};
}

}  // namespace malus::internal
