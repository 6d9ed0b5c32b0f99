# The last word on the staged tree, before it is packed: what CMake's install rules cannot say, and one time for all.
set(root "${CPACK_TEMPORARY_INSTALL_DIRECTORY}")

# The administrator's configurations. It is not below the prefix, and it is empty: the package has no conffiles.
file(MAKE_DIRECTORY "${root}/etc/twinlock")

# Whatever the caller's umask was.
execute_process(COMMAND find "${root}" -type d -exec chmod 755 {} + COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND find "${root}" -exec touch --no-dereference "--date=@$ENV{SOURCE_DATE_EPOCH}" {} +
    COMMAND_ERROR_IS_FATAL ANY)
