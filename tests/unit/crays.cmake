add_executable(crays_test ${CMAKE_CURRENT_LIST_DIR}/bsdf_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/caustics_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/clear_path_test.cpp ${CMAKE_CURRENT_LIST_DIR}/finish_test.cpp ${CMAKE_CURRENT_LIST_DIR}/lights_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/path_tracer_test.cpp ${CMAKE_CURRENT_LIST_DIR}/photon_guide_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/ray_ends_test.cpp ${CMAKE_CURRENT_LIST_DIR}/smooth_surfaces_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/lens_test.cpp ${CMAKE_CURRENT_LIST_DIR}/light_tree_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/emitters_test.cpp ${CMAKE_CURRENT_LIST_DIR}/plain_lanes_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/photon_lots_test.cpp ${CMAKE_CURRENT_LIST_DIR}/turn_shares_test.cpp)
target_link_libraries(crays_test PRIVATE trex_paths GTest::gtest_main)
trex_gtest(crays_test)
