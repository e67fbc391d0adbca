/* Runs a harness over files instead of over a fuzzer's inventions: replay [FILE|FOLDER]... */
#include <dirent.h>
#include <string.h>

#include "fuzz.h"

static unsigned long replayed;

static void replay_file(const char *path)
{
    FILE *file = fopen(path, "rb");
    FUZZ_CHECK(file != NULL);
    FUZZ_CHECK(fseek(file, 0, SEEK_END) == 0);
    long size = ftell(file);
    FUZZ_CHECK(size >= 0 && fseek(file, 0, SEEK_SET) == 0);
    uint8_t *bytes = malloc(size > 0 ? (size_t)size : 1); /* exactly as long as the input: the sanitizer sees its ends */
    FUZZ_CHECK(bytes != NULL && fread(bytes, 1, (size_t)size, file) == (size_t)size);
    fclose(file);
    printf("%s\n", path);
    fflush(stdout);
    LLVMFuzzerTestOneInput(bytes, (size_t)size);
    free(bytes);
    replayed++;
}

static void replay(const char *path)
{
    char name[4096];
    DIR *folder = opendir(path);
    if (folder == NULL) {
        replay_file(path);
        return;
    }
    for (struct dirent *entry = readdir(folder); entry != NULL; entry = readdir(folder)) {
        if (entry->d_name[0] != '.') {
            int length = snprintf(name, sizeof name, "%s/%s", path, entry->d_name);
            FUZZ_CHECK(length > 0 && (size_t)length < sizeof name);
            replay_file(name);
        }
    }
    closedir(folder);
}

int main(int count, char **paths)
{
    for (int i = 1; i < count; i++) {
        replay(paths[i]);
    }
    printf("%lu inputs replayed\n", replayed);
    return replayed > 0 ? 0 : 1;
}
