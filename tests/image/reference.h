// Scenes and references of the image tests, by name.
#pragma once

#include <string>

#include "src/scene/scene.h"
#include "tests/image/rendered.h"

namespace trex::test {

/// NAME.glb as scenes.py writes it in the build folder, with the sky that its reference was made
/// with; "cornell" is the asset.
Scene importTestScene(const std::string& name);

/// refs/NAME.exr. Throws Error(kInput) if the file or a layer is missing.
Rendered readReference(const std::string& name);

}  // namespace trex::test
