/* TL_HAS_SANITIZER: 1 if this program was built with AddressSanitizer or ThreadSanitizer, else 0. A
 * sanitizer needs memory without a limit. Its leak check uses a process that traces this one. */
#ifndef TL_FIRMWARE_PROCESS_SANITIZER_H
#define TL_FIRMWARE_PROCESS_SANITIZER_H

#if defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define TL_HAS_SANITIZER 1
#endif
#endif
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define TL_HAS_SANITIZER 1
#endif
#if !defined(TL_HAS_SANITIZER)
#define TL_HAS_SANITIZER 0
#endif

#endif
