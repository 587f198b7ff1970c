trex_program_test(exit_codes_test exit_codes_test.py --assets ${CMAKE_SOURCE_DIR}/assets)
