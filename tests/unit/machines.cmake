add_executable(machines_test ${CMAKE_CURRENT_LIST_DIR}/machines_test.cpp ${CMAKE_CURRENT_LIST_DIR}/machine_jobs_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/machine_links_test.cpp ${CMAKE_CURRENT_LIST_DIR}/machine_pages_test.cpp ${CMAKE_CURRENT_LIST_DIR}/machine_photons_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/machine_loans_test.cpp ${CMAKE_CURRENT_LIST_DIR}/machine_window_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/machine_files_test.cpp)
target_link_libraries(machines_test PRIVATE trex_machines GTest::gtest_main)
trex_gtest(machines_test)
trex_program_test(machines_command_test machines_command_test.py)
