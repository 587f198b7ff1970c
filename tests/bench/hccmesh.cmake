add_executable(hccmesh_bench ${CMAKE_CURRENT_LIST_DIR}/hccmesh_bench.cpp)
target_link_libraries(hccmesh_bench PRIVATE trex_rays CLI11::CLI11 nlohmann_json::nlohmann_json)
add_executable(crack_bench ${CMAKE_CURRENT_LIST_DIR}/crack_bench.cpp)
target_link_libraries(crack_bench PRIVATE trex_rays CLI11::CLI11 nlohmann_json::nlohmann_json)
