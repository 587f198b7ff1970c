// A look as a small JSON overlay on the scene it belongs to: only what differs is in it. Written by
// the viewer, read by it and by `trex render --edits`.
//
//   {"trex": 1, "edits_of": "model.glb",
//    "camera": {"eye": [0, 1, 5], "forward": [0, 0, -1], "up": [0, 1, 0], ...}, "exposure": 0.5,
//    "materials": [{"index": 3, "name": "gold", "roughness": 0.1}],
//    "lights": [ all of them, if any differs ],
//    "environment": {"color": [1, 1, 1], "rotation_radians": 0.5},
//    "hidden": [{"index": 7, "name": "roof"}],
//    "section": {"point": [0, 1, 0], "normal": [0, 1, 0]},
//    "light": {"photons": 115200, "aim": {a camera}}}
//
// "light" is no edit: it tells the photons of the frame that was seen, so that a capture of the
// same look repeats its pixels.
//
// Materials and objects go by index; where the name at that index is another one (the model was
// exported anew), the only one of that name is meant.
#pragma once

#include <filesystem>
#include <string>

#include "src/scene/look.h"

namespace trex {

/// Photons of a frame; see RenderSettings.
struct LookLight {
  std::uint64_t photons = 0;
  std::optional<Camera> aim;
};

/// The overlay that turns lookOf(scene) into `look`.
std::string lookText(const Look& look, const Scene& scene, const Look& source,
                     const LookLight& light = {});

/// Writes it beside `path` and renames it. Throws Error(kOutput).
void writeLook(const std::filesystem::path& path, const Look& look, const Scene& scene,
               const Look& source, const LookLight& light = {});

/// Reads an overlay over `source`, a look of `scene`. Unknown keys, names and values out of range
/// throw Error(kInput) with the file and the JSON pointer; at most 64 MiB are read.
Look readLook(const std::filesystem::path& path, const Scene& scene, const Look& source,
              LookLight* light = nullptr);
/// Likewise of a text. `name`: for messages.
Look parseLook(const std::string& text, const std::string& name, const Scene& scene,
               const Look& source, LookLight* light = nullptr);

}  // namespace trex
