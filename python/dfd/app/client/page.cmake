# Builds the page into python/dfd/app/static if npm is installed and the page is older than its sources. If npm is
# missing or fails, there is no new page. With DFD_RELEASE=1, the build fails if npm fails or there is no page.
set(client ${CMAKE_CURRENT_LIST_DIR})
set(page ${client}/../static/index.html)

if(CMAKE_SCRIPT_MODE_FILE)
  execute_process(COMMAND ${NPM} ci --silent --no-audit --no-fund WORKING_DIRECTORY ${client} RESULT_VARIABLE failed)
  if(NOT failed)
    execute_process(COMMAND ${NPM} run --silent build WORKING_DIRECTORY ${client} RESULT_VARIABLE failed)
  endif()
  if(failed AND "$ENV{DFD_RELEASE}")
    message(FATAL_ERROR "The app's page could not be built, and a release must have it.")
  elseif(failed)
    message(WARNING "The app's page could not be built; everything else works without it.")
  endif()
  return()
endif()

if(SKBUILD_STATE STREQUAL "sdist")
  if(NOT EXISTS ${page})
    message(WARNING "The source distribution will lack the app's page. `make release` and `npm run build` make the page.")
  endif()
  return()
endif()

find_program(NPM NAMES npm.cmd npm)
if(NPM)
  file(GLOB_RECURSE page_sources CONFIGURE_DEPENDS ${client}/src/* ${client}/public/*)
  list(FILTER page_sources EXCLUDE REGEX "/messages\\.ts$") # only types, which the built page does not contain
  list(APPEND page_sources ${client}/index.html ${client}/package-lock.json ${client}/vite.config.ts)
  add_custom_command(
    OUTPUT ${page}
    COMMAND ${CMAKE_COMMAND} -DNPM=${NPM} -P ${client}/page.cmake
    DEPENDS ${page_sources}
    COMMENT "Building the app's page"
    VERBATIM)
  add_custom_target(page ALL DEPENDS ${page})
elseif("$ENV{DFD_RELEASE}" AND NOT EXISTS ${page})
  message(FATAL_ERROR "npm was not found and the app's page is not built, and a release must have it.")
elseif(NOT EXISTS ${page})
  message(STATUS "npm was not found: the package is built without the app's page")
endif()
