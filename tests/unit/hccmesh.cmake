add_executable(hccmesh_test
  ${CMAKE_CURRENT_LIST_DIR}/hccmesh_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/hccmesh_extremes_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/hccmesh_format_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/hccmesh_pack_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/hccmesh_trace_test.cpp)
target_link_libraries(hccmesh_test PRIVATE hccmesh GTest::gtest_main)
find_path(XXHASH_INCLUDE_DIR xxhash.h REQUIRED)
target_include_directories(hccmesh_test SYSTEM PRIVATE ${XXHASH_INCLUDE_DIR})
trex_gtest(hccmesh_test)

add_executable(ray_scene_test ${CMAKE_CURRENT_LIST_DIR}/ray_scene_test.cpp)
target_link_libraries(ray_scene_test PRIVATE trex_rays GTest::gtest_main)
trex_gtest(ray_scene_test)

add_executable(pages_test ${CMAKE_CURRENT_LIST_DIR}/stream_build_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/page_cache_test.cpp ${CMAKE_CURRENT_LIST_DIR}/unpacked_pages_test.cpp)
target_link_libraries(pages_test PRIVATE hccmesh GTest::gtest_main)
trex_gtest(pages_test)
# gcc 12 takes copies of a decoded triangle for uninitialised, at -O3 only.
set_source_files_properties(${CMAKE_CURRENT_LIST_DIR}/stream_build_test.cpp PROPERTIES COMPILE_OPTIONS
  -Wno-maybe-uninitialized)
