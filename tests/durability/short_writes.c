/* Stands before the C library's pwrite64 and cuts each SHORT_WRITES_EVERY-th write in half, as a
 * disk or a signal may. Each cut adds a byte to the file SHORT_WRITES_LOG. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <stdlib.h>
#include <unistd.h>

typedef ssize_t (*write_at)(int, const void *, size_t, off_t);

ssize_t pwrite64(int file, const void *bytes, size_t length, off_t offset)
{
    static write_at next;
    static int every, log_file = -1;
    static unsigned calls;
    if (!next) {
        every = atoi(getenv("SHORT_WRITES_EVERY"));
        log_file = open(getenv("SHORT_WRITES_LOG"), O_WRONLY | O_CREAT | O_APPEND, 0600);
        next = (write_at)dlsym(RTLD_NEXT, "pwrite64");
    }
    if (length > 1 && __sync_add_and_fetch(&calls, 1) % every == 0) {
        if (write(log_file, ".", 1) != 1)
            abort();
        length /= 2;
    }
    return next(file, bytes, length, offset);
}
