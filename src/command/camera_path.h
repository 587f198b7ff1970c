// Camera paths: a file with one camera a picture.
//
//   {"trex": 1, "cameras": ["NAME",
//                           {"eye": [0, 1, 5], "target": [0, 1, 0], "up": [0, 1, 0], "vfov": 40,
//                            "fstop": 2.8, "focus": 5}]}
//
// A camera is the name of one of the scene's, or where it stands: metres and degrees; "up" is
// [0, 1, 0] and "vfov" 40 where they are left out, and without "fstop" and "focus" all is sharp.
#pragma once

#include <filesystem>
#include <vector>

#include "src/scene/scene.h"

namespace trex {

/// Reads such a file. Throws Error(kInput) that names the file and the place in it.
std::vector<Camera> readCameraPath(const std::filesystem::path& path, const Scene& scene);

}  // namespace trex
