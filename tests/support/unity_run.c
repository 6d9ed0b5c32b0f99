/* Runs one case in place of Unity's own UnityDefaultTestRun(): tearDown() also runs to its end after a case that failed.
 *
 * Unity's own leaves tearDown() at its first assertion then, even if that holds: threads and files of the case stay for the next one. */
#include <stdbool.h>

#include <unity.h>

void UnityDefaultTestRun(UnityTestFunction Func, const char *FuncName, const int FuncLineNum) {
    static bool has_failed; /* static: setjmp() leaves them alone */
    static bool is_ignored;
    Unity.CurrentTestName = FuncName;
    Unity.CurrentTestLineNumber = (UNITY_LINE_TYPE)FuncLineNum;
    Unity.NumberOfTests++;
    UNITY_CLR_DETAILS();
    if (TEST_PROTECT()) {
        setUp();
        Func();
    }
    has_failed = Unity.CurrentTestFailed != 0;
    is_ignored = Unity.CurrentTestIgnored != 0;
    Unity.CurrentTestFailed = 0;
    Unity.CurrentTestIgnored = 0;
    if (TEST_PROTECT()) {
        tearDown();
    }
    Unity.CurrentTestFailed = has_failed || Unity.CurrentTestFailed != 0 ? 1 : 0;
    Unity.CurrentTestIgnored = is_ignored && Unity.CurrentTestFailed == 0 ? 1 : 0;
    UnityConcludeTest();
}
