"""Networks as they are asked, one window at a time: convolutions as products with rows of samples.

A window has few samples (seven in the last and largest layers), so that time goes into reading weights. torch's own
convolution takes four times as long as a product that reads them once. Normalisation is folded into the weights.
"""

from __future__ import annotations

from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_weights


class _Product(nn.Module):
    """A convolution over time and the normalisation after it.

    Args:
        conv: Padded by zeros, without bias.
        norm: In the state of being asked.
    """

    def __init__(self, conv: nn.Conv1d, norm: nn.BatchNorm1d) -> None:
        super().__init__()
        assert norm.running_mean is not None
        assert norm.running_var is not None
        weight, bias = fuse_conv_bn_weights(
            conv.weight, conv.bias, norm.running_mean, norm.running_var, norm.eps, norm.weight, norm.bias
        )
        self.weight: Tensor
        self.bias: Tensor
        self.register_buffer("weight", weight.detach().flatten(1).contiguous())
        self.register_buffer("bias", bias.detach())
        self._size, self._stride = conv.kernel_size[0], conv.stride[0]
        self._padding = int(conv.padding[0])

    def forward(self, x: Tensor) -> Tensor:
        if self._padding:
            x = nn.functional.pad(x, (self._padding, self._padding))
        rows = x.unfold(2, self._size, self._stride).transpose(1, 2).flatten(2)
        return nn.functional.linear(rows, self.weight, self.bias).transpose(1, 2)


def for_inference(network: nn.Module) -> nn.Module:
    """The same network (it is changed) with every convolution that a normalisation follows as one product."""
    for module in list(network.modules()):
        before: tuple[str, nn.Module] | None = None
        for name, child in list(module.named_children()):
            if isinstance(child, nn.BatchNorm1d) and before is not None and isinstance(before[1], nn.Conv1d):
                setattr(module, before[0], _Product(before[1], child))
                setattr(module, name, nn.Identity())
            before = name, child
    return network.eval()
