/* Certificate: see certificate.h. */
#include "firmware/serve/certificate.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <gnutls/gnutls.h>
#include <gnutls/x509.h>

#include "firmware/base/os.h"

enum { MOST = 64 * 1024, SERIAL = 16, VERSION = 3, DIGEST = 32 };

static const char NAME[] = "server.pem";
static const time_t VALID_FROM = 1577836800; /* 2020-01-01T00:00:00Z */

/* ---- reading ---- */

static tl_status read_pem(const char *path, char **text, tl_error *error) {
    char *bytes = malloc(MOST + 1);
    int file = open(path, O_RDONLY | O_CLOEXEC);
    ssize_t size = file < 0 || bytes == NULL ? -1 : tl_file_bytes_read(file, bytes, MOST);
    int cause = errno;
    if (file >= 0) {
        (void)close(file);
    }
    if (size < 0) {
        free(bytes);
        return tl_fail(error, TL_TRY_AGAIN, "%s: cannot be read: %s", path, strerror(cause));
    }
    bytes[size] = '\0';
    *text = bytes;
    return TL_OK;
}

/* ---- fingerprints ---- */

static void write_hex(const unsigned char digest[DIGEST], char text[TL_FINGERPRINT_TEXT]) {
    for (size_t i = 0; i < DIGEST; i++) {
        (void)snprintf(text + 3 * i, 4, "%02X%s", digest[i], i + 1 < DIGEST ? ":" : "");
    }
}

static bool write_pin(unsigned char digest[DIGEST], char text[TL_FINGERPRINT_TEXT]) {
    const gnutls_datum_t plain = {digest, DIGEST};
    gnutls_datum_t encoded = {NULL, 0};
    if (gnutls_base64_encode2(&plain, &encoded) < 0) {
        return false;
    }
    (void)snprintf(text, TL_FINGERPRINT_TEXT, "sha256//%.*s", (int)encoded.size, (const char *)encoded.data);
    gnutls_free(encoded.data);
    return true;
}

static bool write_fingerprint(gnutls_x509_crt_t certificate, tl_fingerprint *fingerprint) {
    unsigned char key[DIGEST];
    unsigned char whole[DIGEST];
    size_t key_size = sizeof key;
    size_t size = sizeof whole;
    if (gnutls_x509_crt_get_key_id(certificate, GNUTLS_KEYID_USE_SHA256, key, &key_size) < 0 || key_size != DIGEST ||
        gnutls_x509_crt_get_fingerprint(certificate, GNUTLS_DIG_SHA256, whole, &size) < 0 || size != DIGEST) {
        return false;
    }
    write_hex(whole, fingerprint->certificate);
    return write_pin(key, fingerprint->pin);
}

/* The server's certificate is the first of the chain. */
static bool find_fingerprint(const gnutls_datum_t *chain, tl_fingerprint *fingerprint) {
    gnutls_x509_crt_t first = NULL;
    bool is_found = gnutls_x509_crt_init(&first) >= 0 &&
                    gnutls_x509_crt_import(first, chain, GNUTLS_X509_FMT_PEM) >= 0 &&
                    write_fingerprint(first, fingerprint);
    gnutls_x509_crt_deinit(first); /* NULL is allowed */
    return is_found;
}

/* ---- loading ---- */

static gnutls_datum_t datum_of(char *text) {
    return (gnutls_datum_t){(unsigned char *)text, (unsigned)strlen(text)};
}

/* Also checks that the key belongs to the certificate. */
static tl_status check_pair(const char *path, tl_certificate *certificate, tl_error *error) {
    gnutls_certificate_credentials_t credentials = NULL;
    const gnutls_datum_t chain = datum_of(certificate->chain);
    const gnutls_datum_t key = datum_of(certificate->key);
    int failure = gnutls_certificate_allocate_credentials(&credentials);
    if (failure >= 0) {
        failure = gnutls_certificate_set_x509_key_mem(credentials, &chain, &key, GNUTLS_X509_FMT_PEM);
        gnutls_certificate_free_credentials(credentials);
    }
    if (failure < 0) {
        return tl_fail(error, TL_BAD_DATA, "%s: expected a certificate with its key (PEM): %s", path,
                       gnutls_strerror(failure));
    }
    return find_fingerprint(&chain, &certificate->fingerprint)
               ? TL_OK
               : tl_fail(error, TL_BAD_DATA, "%s: the certificate has an unknown type of key: use ECDSA or RSA", path);
}

tl_status tl_certificate_load(const char *chain, const char *key, tl_certificate *certificate, tl_error *error) {
    *certificate = (tl_certificate){.chain = NULL};
    tl_status status = read_pem(chain, &certificate->chain, error);
    status = status == TL_OK ? read_pem(key, &certificate->key, error) : status;
    status = status == TL_OK ? check_pair(chain, certificate, error) : status;
    if (status != TL_OK) {
        tl_certificate_free(certificate);
    }
    return status;
}

void tl_certificate_free(tl_certificate *certificate) {
    if (certificate->key != NULL) {
        explicit_bzero(certificate->key, strlen(certificate->key));
    }
    free(certificate->chain);
    free(certificate->key);
    *certificate = (tl_certificate){.chain = NULL};
}

/* ---- generating ---- */

/* "99991231235959Z" means a certificate without an end (RFC 5280). If time_t has 32 bits, its last
 * second is used. */
static time_t no_end(void) {
    const int64_t end = INT64_C(253402300799);
    return sizeof(time_t) > sizeof(int32_t) ? (time_t)end : (time_t)INT32_MAX;
}

/* Each of these returns at least 0, or an error code of GnuTLS. */
static int describe(gnutls_x509_crt_t made, gnutls_x509_privkey_t key) {
    unsigned char serial[SERIAL];
    char host[HOST_NAME_MAX + 1] = "";
    if (getrandom(serial, sizeof serial, 0) != (ssize_t)sizeof serial || gethostname(host, sizeof host - 1) != 0) {
        return GNUTLS_E_RANDOM_FAILED;
    }
    serial[0] = (unsigned char)(serial[0] & 0x7FU) | 1U; /* positive, and the first byte is not 0 */
    int failure = gnutls_x509_crt_set_version(made, VERSION);
    failure = failure < 0 ? failure : gnutls_x509_crt_set_serial(made, serial, sizeof serial);
    failure = failure < 0 ? failure : gnutls_x509_crt_set_activation_time(made, VALID_FROM);
    failure = failure < 0 ? failure : gnutls_x509_crt_set_expiration_time(made, no_end());
    failure = failure < 0 ? failure : gnutls_x509_crt_set_dn(made, "CN=twinlock", NULL);
    failure = failure < 0 ? failure
                          : gnutls_x509_crt_set_subject_alt_name(made, GNUTLS_SAN_DNSNAME, host, (unsigned)strlen(host),
                                                                 GNUTLS_FSAN_SET);
    failure = failure < 0 ? failure : gnutls_x509_crt_set_basic_constraints(made, 0, -1);
    failure = failure < 0 ? failure : gnutls_x509_crt_set_key_usage(made, GNUTLS_KEY_DIGITAL_SIGNATURE);
    failure = failure < 0 ? failure : gnutls_x509_crt_set_key(made, key);
    return failure < 0 ? failure : gnutls_x509_crt_sign2(made, made, key, GNUTLS_DIG_SHA256, 0);
}

static int print_pair(gnutls_x509_crt_t made, gnutls_x509_privkey_t key, FILE *file) {
    gnutls_datum_t chain = {NULL, 0};
    gnutls_datum_t secret = {NULL, 0};
    int failure = gnutls_x509_crt_export2(made, GNUTLS_X509_FMT_PEM, &chain);
    failure = failure < 0
                  ? failure
                  : gnutls_x509_privkey_export2_pkcs8(key, GNUTLS_X509_FMT_PEM, NULL, GNUTLS_PKCS_PLAIN, &secret);
    if (failure >= 0) {
        (void)fprintf(file, "%.*s%.*s", (int)chain.size, (const char *)chain.data, (int)secret.size,
                      (const char *)secret.data);
        gnutls_memset(secret.data, 0, secret.size);
    }
    gnutls_free(chain.data);
    gnutls_free(secret.data);
    return failure;
}

static int print_new(FILE *file) {
    gnutls_x509_privkey_t key = NULL;
    gnutls_x509_crt_t made = NULL;
    int failure = gnutls_x509_privkey_init(&key);
    failure = failure < 0 ? failure : gnutls_x509_crt_init(&made);
    failure = failure < 0 ? failure
                          : gnutls_x509_privkey_generate(key, GNUTLS_PK_ECDSA,
                                                         GNUTLS_CURVE_TO_BITS(GNUTLS_ECC_CURVE_SECP256R1), 0);
    failure = failure < 0 ? failure : describe(made, key);
    failure = failure < 0 ? failure : print_pair(made, key, file);
    gnutls_x509_crt_deinit(made);
    gnutls_x509_privkey_deinit(key);
    return failure;
}

/* Root may request the fingerprint before the server's first start. Then the owner of the folder
 * gets the file. */
static bool restrict_to_owner(int file, const char *folder) {
    struct stat about;
    bool is_set = stat(folder, &about) == 0 && (geteuid() != 0 || fchown(file, about.st_uid, about.st_gid) == 0);
    return is_set && fchmod(file, S_IRUSR | S_IWUSR) == 0;
}

static tl_status make(const char *folder, const char *path, tl_error *error) {
    tl_new_file made;
    tl_status status = tl_new_file_open(path, &made, error);
    if (status != TL_OK) {
        return status;
    }
    if (!restrict_to_owner(fileno(made.file), folder)) {
        tl_new_file_discard(&made);
        return tl_fail(error, TL_TRY_AGAIN, "%s: cannot set its owner and mode: %s", path, strerror(errno));
    }
    int failure = print_new(made.file);
    if (failure < 0) {
        tl_new_file_discard(&made);
        return tl_fail(error, TL_TRY_AGAIN, "cannot generate a key: %s", gnutls_strerror(failure));
    }
    return tl_new_file_keep(&made, error);
}

tl_status tl_certificate_provide(const char *folder, tl_certificate *certificate, tl_error *error) {
    char path[PATH_MAX];
    if (snprintf(path, sizeof path, "%s/%s", folder, NAME) >= PATH_MAX) {
        return tl_fail(error, TL_BAD_USAGE, "%.300s…: the name of the folder is too long", folder);
    }
    struct stat about;
    if (stat(folder, &about) != 0 || !S_ISDIR(about.st_mode)) {
        return tl_fail(error, TL_BAD_DATA,
                       "--state %.300s: there is no such folder; create it for the user of the server", folder);
    }
    tl_status status = access(path, F_OK) == 0 ? TL_OK : make(folder, path, error);
    return status == TL_OK ? tl_certificate_load(path, path, certificate, error) : status;
}
