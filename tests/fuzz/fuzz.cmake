# Fuzz targets (libFuzzer, so clang alone); see scripts/fuzz. A target is tests/fuzz/fuzz_NAME.cpp.
if(NOT CMAKE_CXX_COMPILER_ID STREQUAL "Clang")
  message(FATAL_ERROR "TREX_FUZZ needs clang: use the preset `fuzz`")
endif()
# The warnings are gcc's business; clang has others.
target_compile_options(trex_options INTERFACE -w -fsanitize=fuzzer-no-link,address,undefined
  -fno-sanitize-recover=all -fno-omit-frame-pointer)
target_link_options(trex_options INTERFACE -fsanitize=address,undefined)

add_custom_target(fuzz)
function(trex_fuzz name)
  add_executable(fuzz_${name} ${CMAKE_CURRENT_FUNCTION_LIST_DIR}/fuzz_${name}.cpp)
  target_link_libraries(fuzz_${name} PRIVATE ${ARGN})
  target_link_options(fuzz_${name} PRIVATE -fsanitize=fuzzer)
  add_dependencies(fuzz fuzz_${name})
endfunction()

trex_library(trex_fuzz_import SOURCES ${CMAKE_CURRENT_LIST_DIR}/fuzz.cpp LINK trex_scene)
trex_fuzz(gltf trex_fuzz_import)
trex_fuzz(glb trex_fuzz_import)
trex_fuzz(ply trex_fuzz_import)
trex_fuzz(obj trex_fuzz_import)
trex_fuzz(hccm hccmesh)
trex_fuzz(pack hccmesh)
trex_fuzz(asvo asvo)
trex_fuzz(scene trex_bundle)
trex_fuzz(bundle trex_bundle)

add_executable(fuzz_seeds ${CMAKE_CURRENT_LIST_DIR}/make_seeds.cpp)
target_link_libraries(fuzz_seeds PRIVATE hccmesh asvo)
add_executable(fuzz_bundle_seeds ${CMAKE_CURRENT_LIST_DIR}/make_bundle_seeds.cpp)
target_link_libraries(fuzz_bundle_seeds PRIVATE trex_bundle)
add_dependencies(fuzz fuzz_seeds fuzz_bundle_seeds)
