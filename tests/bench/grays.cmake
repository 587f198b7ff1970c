add_executable(grays_bench ${CMAKE_CURRENT_LIST_DIR}/grays_bench.cpp)
target_link_libraries(grays_bench PRIVATE trex_grays trex_vulkan asvo)
