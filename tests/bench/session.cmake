add_executable(voxel_bench ${CMAKE_CURRENT_LIST_DIR}/voxel_bench.cpp)
target_link_libraries(voxel_bench PRIVATE trex_session nlohmann_json::nlohmann_json)
add_executable(photon_bench ${CMAKE_CURRENT_LIST_DIR}/photon_bench.cpp)
target_link_libraries(photon_bench PRIVATE trex_bundle fmt::fmt)
