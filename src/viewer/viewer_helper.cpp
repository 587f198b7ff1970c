// What other machines are told that take samples for the screen.
#include "src/core/log.h"
#include "src/viewer/viewer_parts.h"

namespace trex {

/// Other machines follow what is shown from now on.
void Viewer::Impl::tellHelper() {
  if (options.helper == nullptr) return;
  options.helper->edited(lookText(history->current(), editor->model().scene, editor->source()),
                         options.settings.width, options.settings.height);
}

/// They have the first model alone.
void Viewer::Impl::leaveHelper() {
  if (options.remote) options.remote->leave();
  if (options.helper == nullptr) return;
  logWarning("the other machines have another model open; going on without them");
  options.helper = nullptr;
}

}  // namespace trex
