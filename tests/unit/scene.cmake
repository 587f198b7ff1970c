add_executable(scene_test ${CMAKE_CURRENT_LIST_DIR}/scene_helpers.cpp
  ${CMAKE_CURRENT_LIST_DIR}/scene_gltf_test.cpp ${CMAKE_CURRENT_LIST_DIR}/scene_files_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/scene_bad_input_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/scene_replaced_test.cpp ${CMAKE_CURRENT_LIST_DIR}/scene_exporters_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/scene_gltf_extensions_test.cpp ${CMAKE_CURRENT_LIST_DIR}/scene_stl_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/scene_light_images_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/scene_stream_test.cpp ${CMAKE_CURRENT_LIST_DIR}/scene_mitsuba_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/scene_mitsuba_looks_test.cpp ${CMAKE_CURRENT_LIST_DIR}/daylight_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/shape_meshes_test.cpp ${CMAKE_CURRENT_LIST_DIR}/spectra_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/scene_pbrt_test.cpp ${CMAKE_CURRENT_LIST_DIR}/scene_pbrt_looks_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/synth_test.cpp)
target_link_libraries(scene_test PRIVATE trex_scene trex_openimageio GTest::gtest_main ${DRACO_LIBRARY} ${MESHOPTIMIZER_LIBRARY} ZLIB::ZLIB)
target_compile_definitions(scene_test PRIVATE
  TREX_SOURCE_DIR="${CMAKE_CURRENT_LIST_DIR}/../..")
trex_gtest(scene_test)

add_executable(texture_cache_test ${CMAKE_CURRENT_LIST_DIR}/texture_cache_test.cpp)
target_link_libraries(texture_cache_test PRIVATE trex_scene trex_openimageio GTest::gtest_main)
trex_gtest(texture_cache_test)
