trex_program_test(view_test view_test.py --assets ${CMAKE_SOURCE_DIR}/assets)
trex_program_test(view_machines_test view_machines_test.py --assets ${CMAKE_SOURCE_DIR}/assets)
