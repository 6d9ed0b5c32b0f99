# Files as constants of a C program: cmake -DOUTPUT=FILE.c -DRESOURCES="name=file;…" -P embed.cmake
# Each becomes a tl_html_resource called tl_html_NAME (firmware/report/html_resources.h).
set(code "/* Made by firmware/report/embed.cmake. */\n#include \"firmware/report/html_resources.h\"\n")
foreach(resource IN LISTS RESOURCES)
    string(REGEX MATCH "^([a-z_]+)=(.*)$" matched "${resource}")
    set(name "${CMAKE_MATCH_1}")
    file(READ "${CMAKE_MATCH_2}" bytes HEX)
    string(REGEX REPLACE "([0-9a-f][0-9a-f])" "0x\\1," bytes "${bytes}")
    string(REGEX REPLACE "(................................................................................)" "\\1\n"
        bytes "${bytes}")
    string(APPEND code "\nstatic const unsigned char ${name}[] = {\n${bytes}};\n"
        "const tl_html_resource tl_html_${name} = {${name}, sizeof ${name}};\n")
endforeach()
file(WRITE "${OUTPUT}" "${code}")
