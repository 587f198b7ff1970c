add_executable(session_test ${CMAKE_CURRENT_LIST_DIR}/session_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/plan_test.cpp ${CMAKE_CURRENT_LIST_DIR}/cone_share_test.cpp ${CMAKE_CURRENT_LIST_DIR}/run_table_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/scheduler_test.cpp ${CMAKE_CURRENT_LIST_DIR}/pages_behind_test.cpp ${CMAKE_CURRENT_LIST_DIR}/look_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/alpha_test.cpp ${CMAKE_CURRENT_LIST_DIR}/light_cache_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/preflight_test.cpp)
target_link_libraries(session_test PRIVATE trex_session GTest::gtest_main)
# Statistics of many samples: minutes under the sanitizers, and no other code runs.
trex_gtest(session_test NOT_SANITIZED Session.StopsAtTheErrorAskedFor Session.EstimatedErrorIsTheError)
trex_program_test(capture_test capture_test.py)
add_executable(dial_test ${CMAKE_CURRENT_LIST_DIR}/dial_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/share_rule_test.cpp ${CMAKE_CURRENT_LIST_DIR}/photon_noise_test.cpp)
target_link_libraries(dial_test PRIVATE trex_session GTest::gtest_main)
trex_gtest(dial_test NOT_SANITIZED Dial.LeavesTheMeanAlone DialSession.TheErrorItTellsIsTheError DialSession.StopsAtTheErrorAskedFor PhotonNoiseSession.WhatIsToldIsHowFarSeedsDiffer)
