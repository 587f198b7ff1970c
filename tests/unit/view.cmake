trex_program_test(view_test view_test.py --assets ${CMAKE_SOURCE_DIR}/assets)
