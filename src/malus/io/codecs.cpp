// Nothing else: linked only where no program defines codecs() itself.
#include "malus/io/codecs.h"

namespace malus {

const Codecs& codecs() { return linked_codecs(); }

}  // namespace malus
