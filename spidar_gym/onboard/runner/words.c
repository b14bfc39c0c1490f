/* Texts: read one from a file, split a line into words, convert words to numbers, say why something is refused. */
#define _POSIX_C_SOURCE 200112L
#include <stdlib.h>
#include <string.h>

#include "runner.h"
#include "spidar_math.h"

int sp_reject(const char *what, const char *why)
{
    fprintf(stderr, "runner: %s%s\n", what, why);
    return 2;
}

char *sp_read_text(const char *path, size_t most)
{
    FILE *in = fopen(path, "rb");
    char *text = in == NULL ? NULL : calloc(1, most + 2);
    size_t size = text == NULL ? 0 : fread(text, 1, most + 1, in);
    const int failed = in == NULL || ferror(in); /* as for a folder */
    if (in != NULL) fclose(in);
    if (text != NULL && (failed || size > most || strlen(text) != size)) { /* never use a truncated text */
        free(text);
        return NULL;
    }
    return text;
}

int sp_split(char *line, char **words)
{
    char *rest = NULL;
    int count = 0;
    line[strcspn(line, "#\r\n")] = 0;
    for (char *w = strtok_r(line, " \t", &rest); w != NULL; w = strtok_r(NULL, " \t", &rest)) {
        if (count == SP_WORDS) return -1;
        words[count++] = w;
    }
    return count;
}

/* Convert a word to a number; returns 0 if it is not one. */
static int number(const char *word, double *value)
{
    char *end;
    *value = strtod(word, &end);
    return *word != 0 && *end == 0 && sp_finite(value, 1);
}

int sp_numbers(char **words, int count, int n, double *values)
{
    if (count != n + 1) return 0;
    for (int i = 0; i < n; i++)
        if (!number(words[i + 1], values + i)) return 0;
    return 1;
}
