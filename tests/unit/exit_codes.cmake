add_test(NAME exit_codes_test COMMAND ${Python3_EXECUTABLE} ${CMAKE_CURRENT_LIST_DIR}/exit_codes_test.py
  --trex $<TARGET_FILE:trex> --assets ${CMAKE_SOURCE_DIR}/assets)
set_tests_properties(exit_codes_test PROPERTIES LABELS program TIMEOUT 900)
