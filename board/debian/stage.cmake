# The last word on the staged tree, before it is packed: what CMake's install rules cannot say, and one time for all.
set(root "${CPACK_TEMPORARY_INSTALL_DIRECTORY}")

# The administrator's configurations. It is not below the prefix, and it is empty: that package has no conffiles.
file(MAKE_DIRECTORY "${root}/twinlock/etc/twinlock")
if(EXISTS "${root}/serve")
    file(MAKE_DIRECTORY "${root}/serve/etc/twinlock-serve" "${root}/serve/etc/default")
    file(COPY_FILE "${CMAKE_CURRENT_LIST_DIR}/twinlock-serve.default" "${root}/serve/etc/default/twinlock-serve")
    file(CHMOD "${root}/serve/etc/default/twinlock-serve" PERMISSIONS OWNER_READ OWNER_WRITE GROUP_READ WORLD_READ)
endif()

# Whatever the caller's umask was.
execute_process(COMMAND find "${root}" -type d -exec chmod 755 {} + COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND find "${root}" -exec touch --no-dereference "--date=@$ENV{SOURCE_DATE_EPOCH}" {} +
    COMMAND_ERROR_IS_FATAL ANY)
