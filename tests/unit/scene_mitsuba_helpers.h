// Mitsuba scenes written by tests.
#pragma once

#include "tests/unit/scene_helpers.h"

namespace trex::test {

class Mitsuba : public SceneTest {
 protected:
  /// A scene of this text and a rectangle, unless it has a shape.
  Scene read(const std::string& text, const ImportOptions& options = {},
             const char* version = "3.0.0") {
    const bool bare = text.find("<shape") == text.npos;
    return import("scene.xml",
                  std::string("<scene version=\"") + version + "\">\n" + text +
                      (bare ? "<shape type=\"rectangle\"/>" : "") + "\n</scene>\n",
                  options);
  }
  /// The material of a rectangle with this bsdf.
  Material material(const std::string& bsdf, const char* version = "3.0.0") {
    const Scene s = read("<shape type=\"rectangle\">" + bsdf + "</shape>", {}, version);
    return s.materials.at(s.meshes.at(s.instances.at(0).mesh).material);
  }
  std::string refusal(const std::string& xml, const ImportOptions& options = {},
                      ExitCode code = ExitCode::kInput) {
    try {
      import("scene.xml", xml, options);
    } catch (const Error& e) {
      EXPECT_EQ(e.code(), code);
      return e.what();
    }
    ADD_FAILURE() << "was accepted";
    return "";
  }
};

inline void expectNear(const vec3& a, const vec3& b, float tolerance = 1e-5f) {
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(a[c], b[c], tolerance) << "channel " << c;
}

inline bool says(const std::vector<std::string>& texts, const std::string& what) {
  for (const std::string& t : texts) {
    if (t.find(what) != t.npos) return true;
  }
  return false;
}

inline dvec3 place(const Scene& s, const dvec3& p) {
  return dvec3(s.instances.at(0).transform * glm::dvec4(p, 1.0));
}

inline std::string shapeAt(const std::string& transform) {
  return "<shape type=\"rectangle\"><transform name=\"to_world\">" + transform +
         "</transform></shape>";
}

}  // namespace trex::test
