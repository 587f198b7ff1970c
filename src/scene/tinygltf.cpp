// The implementation of the header-only tinygltf, once.
#define TINYGLTF_IMPLEMENTATION
#include "src/scene/gltf_detail.h"
