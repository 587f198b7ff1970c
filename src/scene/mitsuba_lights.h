// Emitters that are no shapes, and sensors, of a Mitsuba scene.
#pragma once

#include "src/scene/mitsuba_context.h"

namespace trex::detail::mitsuba {

/// Adds a light, or sets the environment.
void addEmitter(Context& context, const Element& emitter);

/// Adds a camera.
void addSensor(Context& context, const Element& sensor);

}  // namespace trex::detail::mitsuba
