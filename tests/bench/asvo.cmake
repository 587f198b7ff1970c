add_executable(asvo_bench ${CMAKE_CURRENT_LIST_DIR}/asvo_bench.cpp)
target_link_libraries(asvo_bench PRIVATE asvo)
