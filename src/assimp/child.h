// trex-assimp FILE DESCRIPTOR: reads a model with assimp and writes it as binary glTF.
//
// A program of its own: whatever assimp does to itself with a hostile file stays there, and the
// start of trex does not pay for its libraries. It is started by src/scene/assimp_file.cpp, which
// limits its memory and its time, and reads what it wrote as carefully as any file.
//
// What was written: with kAssimpRead binary glTF 2.0; asset.extras has lists of texts: `replaced`,
// what is not shown as the file has it, `warnings`, and `files` besides FILE that were opened. Else
// the reason, as a text. Materials whose maps of `roughness`, `metalness` or `opacity` are images
// of their own have them in extras.trex_maps, as glTF's textureInfo; the first two come before
// their factors, the last is multiplied by that of the colour.
#pragma once

namespace trex {

inline constexpr const char* kAssimpProgram = "trex-assimp";

/// Its exit codes.
inline constexpr int kAssimpRead = 0, kAssimpRefused = 3, kAssimpTooLarge = 4;

}  // namespace trex
