import { Button } from "@mantine/core";
import { Link } from "react-router";
import { StateBox } from "../../ui/notice";
import { Shell } from "../../ui/shell";
import { stepsOf } from "./state";

export function NotFound() {
  return (
    <Shell steps={stepsOf(undefined, undefined, [], "")} current={null}>
      <main>
        <StateBox title="There is nothing at this address">
          <p>The link may be cut off, or the recording was removed.</p>
          <Button component={Link} to="/" variant="default" mt="md">
            Start page
          </Button>
        </StateBox>
      </main>
    </Shell>
  );
}
