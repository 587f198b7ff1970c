# Fuzz targets: tests/fuzz/fuzz_NAME.cpp. With TREX_FUZZ on libFuzzer (clang; see scripts/fuzz), under
# TREX_SANITIZE as tests that make the same changes every time.
if(TREX_FUZZ)
  if(NOT CMAKE_CXX_COMPILER_ID STREQUAL "Clang")
    message(FATAL_ERROR "TREX_FUZZ needs clang: use the preset `fuzz`")
  endif()
  # The warnings are gcc's business; clang has others. Comparisons are not traced: those that UBSan
  # adds would take up to 40 % of the time, and the dictionaries have what is compared with.
  target_compile_options(trex_options INTERFACE -w -fsanitize=fuzzer-no-link,address,undefined
    -fno-sanitize-coverage=trace-cmp -fno-sanitize-recover=all -fno-omit-frame-pointer)
  target_link_options(trex_options INTERFACE -fsanitize=address,undefined)
endif()

add_custom_target(fuzz)
# Numbers are cut and fields left out on purpose. Options of sources come after those of targets.
file(GLOB sources ${CMAKE_CURRENT_LIST_DIR}/*.cpp)
set_source_files_properties(${sources} PROPERTIES COMPILE_OPTIONS
  "-Wno-conversion;-Wno-missing-field-initializers")
# `runs`: of the test.
function(trex_fuzz name runs)
  add_executable(fuzz_${name} ${CMAKE_CURRENT_FUNCTION_LIST_DIR}/fuzz_${name}.cpp)
  target_link_libraries(fuzz_${name} PRIVATE ${ARGN})
  add_dependencies(fuzz fuzz_${name})
  if(TREX_FUZZ)
    target_link_options(fuzz_${name} PRIVATE -fsanitize=fuzzer)
    return()
  endif()
  target_sources(fuzz_${name} PRIVATE ${CMAKE_CURRENT_FUNCTION_LIST_DIR}/standalone.cpp)
  add_test(NAME fuzz_${name} COMMAND fuzz_${name} ${CMAKE_BINARY_DIR}/seeds/${name} ${runs})
  set_tests_properties(fuzz_${name} PROPERTIES FIXTURES_REQUIRED fuzz_seeds TIMEOUT 300)
endfunction()

trex_library(trex_fuzz_import SOURCES ${CMAKE_CURRENT_LIST_DIR}/fuzz.cpp LINK trex_scene)
trex_fuzz(gltf 4000 trex_fuzz_import)
trex_fuzz(glb 4000 trex_fuzz_import)
trex_fuzz(assimp 4000 trex_fuzz_import)
trex_fuzz(ply 20000 trex_fuzz_import)
trex_fuzz(obj 20000 trex_fuzz_import)
trex_fuzz(stl 20000 trex_fuzz_import)
trex_fuzz(pbrt 4000 trex_fuzz_import)
trex_fuzz(mitsuba 10000 trex_fuzz_import)
trex_fuzz(hccm 10000 hccmesh)
trex_fuzz(pages 20000 hccmesh)
find_path(XXHASH_INCLUDE_DIR xxhash.h REQUIRED)
target_include_directories(fuzz_pages SYSTEM PRIVATE ${XXHASH_INCLUDE_DIR})
trex_fuzz(pack 20000 hccmesh)
trex_fuzz(asvo 20000 asvo)
trex_fuzz(scene 4000 trex_bundle)
trex_fuzz(bundle 4000 trex_bundle)
trex_fuzz(machines 20000 trex_machines)

add_executable(fuzz_seeds ${CMAKE_CURRENT_LIST_DIR}/make_seeds.cpp)
target_link_libraries(fuzz_seeds PRIVATE hccmesh asvo)
add_executable(fuzz_bundle_seeds ${CMAKE_CURRENT_LIST_DIR}/make_bundle_seeds.cpp)
target_link_libraries(fuzz_bundle_seeds PRIVATE trex_bundle)
add_executable(fuzz_machine_seeds ${CMAKE_CURRENT_LIST_DIR}/make_machine_seeds.cpp)
target_link_libraries(fuzz_machine_seeds PRIVATE trex_machines)
add_dependencies(fuzz fuzz_seeds fuzz_bundle_seeds fuzz_machine_seeds)
if(NOT TREX_FUZZ)
  set(seeds ${CMAKE_BINARY_DIR}/seeds)
  add_test(NAME fuzz_text_seeds
    COMMAND ${Python3_EXECUTABLE} ${CMAKE_CURRENT_LIST_DIR}/make_seeds.py ${seeds})
  add_test(NAME fuzz_seeds COMMAND fuzz_seeds ${seeds})
  add_test(NAME fuzz_bundle_seeds COMMAND fuzz_bundle_seeds ${seeds})
  add_test(NAME fuzz_machine_seeds COMMAND fuzz_machine_seeds ${seeds})
  set_tests_properties(fuzz_text_seeds fuzz_seeds fuzz_bundle_seeds fuzz_machine_seeds PROPERTIES
    FIXTURES_SETUP fuzz_seeds)
endif()
