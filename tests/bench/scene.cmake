add_executable(scene_bench ${CMAKE_CURRENT_LIST_DIR}/scene_bench.cpp)
target_link_libraries(scene_bench PRIVATE trex_scene trex_openimageio nlohmann_json::nlohmann_json)
