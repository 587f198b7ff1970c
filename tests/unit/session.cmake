add_executable(session_test ${CMAKE_CURRENT_LIST_DIR}/session_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/scheduler_test.cpp ${CMAKE_CURRENT_LIST_DIR}/look_test.cpp)
target_link_libraries(session_test PRIVATE trex_session GTest::gtest_main)
# Statistics of many samples: minutes under the sanitizers, and no other code runs.
trex_gtest(session_test NOT_SANITIZED Session.StopsAtTheErrorAskedFor Session.EstimatedErrorIsTheError)
add_test(NAME capture_test COMMAND ${Python3_EXECUTABLE} ${CMAKE_CURRENT_LIST_DIR}/capture_test.py
  --trex $<TARGET_FILE:trex> --assets ${CMAKE_SOURCE_DIR}/assets)
set_tests_properties(capture_test PROPERTIES LABELS program TIMEOUT 900)
